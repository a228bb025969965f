#!/usr/bin/env bash
# Lines of code by room of src/, and of tests, benches and scripts: without blank lines, comments
# and documentation. Prints: name, lines, lines of unit tests beside them.
#
#   scripts/lines.sh [COMMIT]      by default HEAD
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
commit=${1:-HEAD}

git ls-tree -r --name-only "$commit" -- src tests benches scripts | grep -E '\.(rs|py|sh)$' |
    while read -r file; do
        counts=$(git show "$commit:$file" | awk -v file="$file" '
            /^#\[cfg\(test\)\]/ { tests = 1 }
            /^ *$/ || /^ *\/\// || (file !~ /rs$/ && /^ *#/) { next }
            tests || file ~ /^src.*tests(\.rs|\/)/ { of_tests++; next }
            { own++ }
            END { print own + 0, of_tests + 0 }')
        room=${file%%/*}
        if [ "$room" = src ]; then
            room=$(cut -d/ -f1-2 <<<"${file%.rs}")
        fi
        echo "$room $counts"
    done |
    awk '
        { own[$1] += $2; tests[$1] += $3; if ($1 ~ /^src/) { all += $2; all_tests += $3 } }
        END {
            for (room in own) print room, own[room], tests[room]
            print "src-in-all", all, all_tests
        }' | sort
