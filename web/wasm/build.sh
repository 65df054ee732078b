#!/bin/sh
# Builds the WebAssembly decoder: build.sh [OUT], dist/scar.wasm of web/ without it. Needs clang and wasm-ld of version 14 or
# later, such as Debian's packages clang-14 and lld-14; CLANG and WASM_LD name others. The same compiler gives the same bytes.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
kernel=$here/../../scarfmt/kernel
out=${1:-$here/../dist/scar.wasm}
clang=${CLANG:-clang-14}
linker=${WASM_LD:-wasm-ld-14}
objects=$(mktemp -d)
trap 'rm -rf "$objects"' EXIT

# Loops of this folder are written in vectors where that pays: clang 14 makes wrong code of others, such as those that shift
# 16-bit numbers by different amounts (zstd_tables.c).
# shellcheck disable=SC2086
compile() {
    "$clang" --target=wasm32 -std=c11 $3 -msimd128 -mbulk-memory -mmutable-globals -ffreestanding \
        -fno-strict-aliasing -fwrapv -ffp-contract=off -Wall -Wextra -ffile-prefix-map="$here"=. -I"$here/include" -I"$here" -I"$kernel" \
        -c "$1" -o "$objects/$2.o"
}

for name in channel context indices network positions products products_plain rans values; do
    compile "$kernel/$name.c" "kernel_$name" -O3
done
for file in "$here"/*.c; do
    name=$(basename "$file" .c)
    case $name in
        exact | tile_channels | tile_layer) compile "$file" "$name" -O3 ;;
        *) compile "$file" "$name" "-O2 -fno-vectorize -fno-slp-vectorize" ;;
    esac
done
mkdir -p "$(dirname "$out")"
exports=$(sed -n 's/^EXPORT .*\(scar_[a-z_]*\)(.*/--export=\1/p' "$here"/*.c)
# The stack comes first: running over it traps.
# shellcheck disable=SC2086
"$linker" --no-entry --gc-sections --strip-all --stack-first -z stack-size=1048576 $exports --export=__stack_pointer \
    "$objects"/*.o -o "$out"
