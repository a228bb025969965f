#!/usr/bin/env bash
# Lines of code by module of src/, tests, checks and repeated lines by folder, at a commit.
#
#   scripts/lines.sh [COMMIT]    default: HEAD
#
# Code is lines of src/ that are neither blank nor comments, without the unit tests: files
# `tests.rs`, folders `tests`, and modules behind `#[cfg(test)]`. A check is a line that calls
# assert…!, or require…, is_refused…, all_refused, check_all or refused_by…, in Python assert; a
# table of cases counts as the one check that reads it.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
commit=${1:-HEAD}
checks='(assert[a-z_]*!\(|\.?(require|is_refused|all_refused|check_all|refused_by)[a-z_]*\()'

# Files of a folder whose name matches.
files() { git ls-tree -r --name-only "$commit" -- "$1" | { grep -E "$2" || true; }; }

# All lines of a file of src/ without its unit tests; code, those that are neither blank nor
# comment.
counts() {
    git show "$commit:$1" | awk '
        over { next }
        /^#\[cfg\(test\)\]$/ { held = 1; next }
        held && /^mod .*\{$/ { over = 1; next }
        { lines += 1 + held; held = 0 }
        !/^ *(\/\/|$)/ { code++ }
        END { print lines + 0, code + 0 }'
}

echo "| module | lines | code |"
echo "|---|---|---|"
files src '\.rs$' | { grep -vE '/tests(\.rs$|/)' || true; } | while read -r file; do
    module=${file#src/}
    module=${module%%/*}
    echo "${module%.rs} $(counts "$file")"
done | awk '
    { lines[$1] += $2; code[$1] += $3; of_all += $2; all += $3 }
    END {
        for (module in lines) print "| " module " | " lines[module] " | " code[module] " |" | "sort"
        close("sort")
        print "| all | " of_all " | " all " |"
    }'
echo
echo "| folder | lines | tests | checks |"
echo "|---|---|---|---|"
{
    files src '\.rs$'
    files tests '\.(rs|py)$'
    files python/tests '\.py$'
    files benches '\.rs$'
    files scripts .
} | while read -r file; do
    read -r lines tests found < <(git show "$commit:$file" | awk -v checks="$checks" '
        /^ *(#\[test\]|def test_)/ { tests++ }
        $0 ~ checks || /^ *assert / { found++ }
        END { print NR, tests + 0, found + 0 }')
    folder=${file%/*}
    case $file in
    src/*/tests.rs | src/*/tests/*) folder="unit tests in src" ;;
    src/*)
        read -r own _ < <(counts "$file")
        folder="unit tests in src" lines=$((lines - own))
        ;;
    tests/*/*) folder=$(cut -d/ -f1-2 <<<"$file") ;;
    tests/*) folder=$file ;;
    benches/* | scripts/*) folder=${file%%/*} ;;
    esac
    echo "$folder;$lines;$tests;$found"
done | awk -F';' '
    { lines[$1] += $2; tests[$1] += $3; checks[$1] += $4 }
    END {
        for (k in lines) print "| " k " | " lines[k] " | " tests[k] " | " checks[k] " |" | "sort"
    }'

# Pairs of places in a folder that share six or more lines one after the other. Blank lines,
# comments, imports and lines of brackets do not count.
pairs() {
    files "$1" '\.(rs|py|sh)$' | while read -r file; do
        echo ">>> $file"
        git show "$commit:$file"
    done | awk -v shared=6 '
        /^>>> / { script = !/\.rs$/; file++; next }
        { gsub(/^[ \t]+|[ \t]+$/, "") }
        /^(\/\/|use |from |import )/ || /^[][(){};,?.]*$/ || (script && /^#/) { next }
        { line[++n] = $0; of[n] = file }
        END {
            for (k = 1; k + shared - 1 <= n; k++) {
                if (of[k] != of[k + shared - 1]) continue
                key = line[k]
                for (i = 1; i < shared; i++) key = key "\n" line[k + i]
                many = split(places[key], before, " ")
                for (i = 1; i <= many; i++) {
                    m = before[i]
                    overlap = of[m] == of[k] && k - m < shared
                    begun = of[m] == of[m - 1] && of[k] == of[k - 1] && line[m - 1] == line[k - 1]
                    pairs += !overlap && !begun
                }
                places[key] = places[key] " " k
            }
            print pairs + 0
        }'
}

echo
echo "| folder | pairs of places that share six lines |"
echo "|---|---|"
for folder in src tests benches scripts python; do
    echo "| $folder | $(pairs "$folder") |"
done
