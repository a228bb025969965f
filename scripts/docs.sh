#!/usr/bin/env bash
# Builds the documents as a site, into target/docs-site; what `make docs` runs.
#
#   scripts/docs.sh PROGRAM     PROGRAM is phasewarp, whose help becomes docs/commands.md and whose
#                               keys become docs/keys.md
#
# A broken link, a missing anchor and a page without a place in mkdocs.yml end the build.

set -euo pipefail
program=$(realpath "$1")
cd "$(dirname "${BASH_SOURCE[0]}")/.."
target=${CARGO_TARGET_DIR:-target}
pages=target/docs-pages

rm -rf "$pages"
mkdir -p "$pages"
cp -r --parents ./*.md docs cases jobscripts/README.md python/README.md python/notebooks \
    "$pages"

{
    echo "# Commands"
    echo
    echo "What \`phasewarp help COMMAND\` prints. [Usage](usage.md) explains it."
    "$program" --help | sed -n 's/^  \([a-z][a-z-]*\)  .*/\1/p' | while read -r command; do
        if [ "$command" != help ]; then
            printf '\n## %s\n\n```text\n' "$command"
            "$program" help "$command"
            printf '```\n'
        fi
    done
} >"$pages/docs/commands.md"
"$program" schema --markdown >"$pages/docs/keys.md"

NO_MKDOCS_2_WARNING=1 "$target/docs/bin/mkdocs" build --strict
echo "The site is in target/docs-site (python3 -m http.server --directory target/docs-site)"
