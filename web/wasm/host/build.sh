#!/bin/sh
# The same code for the machine at hand: build.sh OUT [FLAG..], such as -fsanitize=address,undefined or -msse4.1. CC names the
# compiler.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
kernel=$here/../../../scarfmt/kernel
out=$1
shift
files=
for name in channel context indices network positions products products_plain rans values; do
    files="$files $kernel/$name.c"
done
for file in "$here"/../*.c; do
    case $(basename "$file") in fault.c | memory.c | libc.c) ;; *) files="$files $file" ;; esac
done
# One kind of products, as in the module; no wider vectors than the flags say.
# shellcheck disable=SC2086
"${CC:-clang-14}" -std=gnu11 -O3 -fno-strict-aliasing -fwrapv -ffp-contract=off -DWIDE_PRODUCTS=0 "$@" \
    -I"$here/.." -I"$kernel" $files "$here/host.c" -lm -o "$out"
