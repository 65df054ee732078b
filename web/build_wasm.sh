#!/bin/sh
# Builds the decoder of scarfmt/native as a WebAssembly module: build_wasm.sh OUT. Needs Python with the package ziglang of
# web/requirements.txt; PYTHON names it. The same version gives the same bytes.
set -eu

native=$(cd "$(dirname "$0")/../scarfmt/native" && pwd)
out=$1
set --
for file in "$native"/*.c "$native"/wasm/*.c; do
    # Without those of the Python library alone.
    case $(basename "$file") in products_avx* | scene.c | work.c | write.c) ;; *) set -- "$@" "$file" ;; esac
done
exports=$(sed -n 's/^EXPORT .*\(scar_[a-z_]*\)(.*/-Wl,--export=\1/p' "$native/scar.h" "$native"/wasm/*.c)
# Zig checks for undefined behaviour unless told not to. Running over the stack traps, since Zig lays it first.
# shellcheck disable=SC2086
"${PYTHON:-python3}" -m ziglang cc --target=wasm32-freestanding -std=c11 -Os -msimd128 -mbulk-memory -ffreestanding -nostdlib \
    -fno-strict-aliasing -fwrapv -ffp-contract=off -fno-sanitize=undefined -fno-stack-protector -Wall -Wextra \
    -ffile-prefix-map="$native"=. -I"$native/wasm/include" -I"$native" "$@" -s -Wl,--no-entry $exports \
    -Wl,--export=__stack_pointer -Wl,-z,stack-size=1048576 -o "$out"
