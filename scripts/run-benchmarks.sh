#!/usr/bin/env bash
# Runs the benchmarks and puts their tables and plots into docs/: `scripts/run-benchmarks.sh [--quick] [NAME...]`.
# Rows go to out/bench/NAME.json and NAME.csv. Wants a quiet machine; the full run takes about an hour.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

options=()
if [[ ${1:-} == --quick ]]; then
    options=(--quick)
    shift
fi
names=("$@")
((${#names[@]})) || names=(surface particles trade report extremes threads leaks light)
program=${WHITEWATER:-target/release/whitewater}
document=docs/benchmarks.md
mkdir -p out/bench docs/plots

for name in "${names[@]}"; do
    plot=()
    case $name in surface | particles | trade | extremes | light) plot=(--plot docs/plots) ;; esac
    echo "== $name"
    "$program" bench "$name" "${options[@]}" "${plot[@]}" --json "out/bench/$name.json" --csv "out/bench/$name.csv" \
        --markdown "out/bench/$name.md"
    # What stands between the marks is replaced.
    {
        echo
        echo "*$(date -u +%Y-%m-%d), $("$program" --version), revision $(git describe --always --dirty),\
 \`whitewater bench $name${options[*]:+ ${options[*]}}\`*"
        echo
        cat "out/bench/$name.md"
        echo
    } >"out/bench/$name.dated.md"
    awk -v begin="<!-- run: begin $name -->" -v end="<!-- run: end $name -->" -v file="out/bench/$name.dated.md" '
        $0 == begin { print; while ((getline line < file) > 0) print line; inside = 1; next }
        $0 == end { inside = 0 }
        !inside { print }
    ' "$document" >"out/bench/document.md"
    cp out/bench/document.md "$document"
done
