#!/usr/bin/env bash
# Lines of code by room: without blank lines, comments and unit tests, which are counted apart.
#
#   scripts/lines.sh [REVISION]     the files that git tracks, as they are, or as of a commit
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

files=$(git ls-files -- '*.rs' '*.py' '*.sh' Makefile)
root=.
if [ $# -gt 0 ]; then
    root=$(mktemp -d)
    trap 'rm -rf "$root"' EXIT
    git archive "$1" | tar -x -C "$root"
    files=$(cd "$root" && find . -name '*.rs' -o -name '*.py' -o -name '*.sh' -o -name Makefile |
        sed 's|^\./||' | sort)
fi

cd "$root"
# shellcheck disable=SC2086 # no name has a space
awk '
    # The room of a file: src/ROOM, or its first folder.
    function room(path,  parts, n) {
        n = split(path, parts, "/")
        if (n == 1) return "(root)"
        if (parts[1] != "src") return parts[1]
        sub(/\.rs$/, "", parts[2])
        return "src/" (n == 2 && parts[2] ~ /^(lib|main)$/ ? "(root)" : parts[2])
    }
    FNR == 1 {
        where = room(FILENAME)
        rooms[where] = 1
        # Docs of Python are comments.
        rust = FILENAME ~ /\.rs$/; python = FILENAME ~ /\.py$/
        test = rust && FILENAME ~ /^src\/.*\/tests(\/|\.rs$)/
        marked = module = quoted = 0
    }
    /^[ \t]*$/ { next }
    rust && /^[ \t]*\/\// { next }
    !rust && /^[ \t]*#/ { next }
    python {
        marks = gsub(/"""/, "\"\"\"")
        if (quoted) { if (marks) quoted = 0; next }
        if ($0 ~ /^[ \t]*r?"""/) { quoted = marks == 1; next }
    }
    # A module of tests ends with the brace in the first column.
    rust && /^#\[cfg\(test\)\]/ { marked = 1; tests[where]++; next }
    marked && /^(pub(\([a-z]*\))? )?mod [a-z_]+ \{/ { module = 1 }
    marked && !module && /^[^#].*[;}]$/ { tests[where]++; marked = 0; next }
    module { tests[where]++; if (/^}/) module = marked = 0; next }
    marked || test { tests[where]++; next }
    { code[where]++ }
    END {
        for (r in rooms) printf "%s %d %d\n", r, code[r], tests[r]
    }
' $files | sort -k1,1 | awk '
    function row(name, code, tests) { printf "%-24s %7d %11d\n", name, code, tests }
    function total(name, code, tests) { row(name, code, tests); print "" }
    BEGIN { printf "%-24s %7s %11s\n", "", "code", "unit tests" }
    # src first: its rooms, then the rest.
    $1 ~ /^src\// { row($1, $2, $3); code += $2; tests += $3; next }
    { others[++n] = $0; all += $2 }
    END {
        total("src", code, tests)
        for (k = 1; k <= n; k++) { split(others[k], o, " "); row(o[1], o[2], o[3]) }
        row("all", code + all, tests)
    }'
