#!/usr/bin/env bash
# Prints instructions per ray, column or particle of every inner loop, counted by callgrind: `make count`, which gives the
# options of the build.
# AVX2 and portable kernels; valgrind knows no AVX-512.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

if ! command -v valgrind >/dev/null; then
    echo "Counting needs valgrind (Debian, Ubuntu, Fedora: the package valgrind)." >&2
    exit 1
fi
# Built like the tests, so that after them there is nothing left to compile but the bench itself.
built=$(cargo test "$@" --bench count --no-run 2>&1) || { echo "$built" >&2; exit 1; }
count=$(sed -nE 's/^ *Executable .*\((.*)\)$/\1/p' <<<"$built" | tail -1)
[[ -x $count ]] || { echo "the bench 'count' was not built" >&2; exit 1; }

printf '%-24s %14s %14s  %s\n' kernel avx2 portable 'instructions per'
"$count" | while read -r name units unit; do
    figures=()
    for level in avx2 portable; do
        total=$(valgrind --tool=callgrind --callgrind-out-file=/dev/null --collect-atstart=no \
            --toggle-collect='whitewater::bench::kernels::counted' "$count" "$level" "$name" 2>&1 </dev/null |
            sed -nE 's/^==[0-9]+== Collected : ([0-9]+).*/\1/p')
        figures+=("$(awk -v total="${total:-0}" -v units="$units" 'BEGIN { printf "%.1f", total / units }')")
    done
    printf '%-24s %14s %14s  %s\n' "$name" "${figures[@]}" "$unit"
done
