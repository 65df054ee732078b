#!/bin/sh
# The whole path on a real scene, with the command a user would type before each result. Needs `scarfmt` on PATH.
set -eu
cd "$(dirname "$0")/.."
scene=examples/plush-toys.ply
views=examples/plush-toys.views.json
out=demo-out
mkdir -p "$out"

if [ -t 1 ]; then bold=$(printf '\033[1m') plain=$(printf '\033[0m'); else bold= plain=; fi
say() { printf '\n%s# %s%s\n' "$bold" "$1" "$plain"; }
run() { printf '$ %s\n' "$*"; "$@"; }

say "Compress a trained scene of $(wc -c < "$scene" | tr -d ' ') bytes, with the options of README's table"
run scarfmt encode "$scene" "$out/toys.scar" --quality 47 --force

say "What is in the file (reads its first 2 KB only)"
run scarfmt inspect "$out/toys.scar"

say "The first layer alone is a file of its own: cut, not encoded again (its directory is shorter, so it is a little smaller than the table says)"
run scarfmt truncate "$out/toys.scar" "$out/toys-layer1.scar" --layers 1 --force
run scarfmt validate "$out/toys-layer1.scar"

say "Back to .ply, which every splat viewer opens"
run scarfmt decode "$out/toys-layer1.scar" "$out/toys-layer1.ply" --force
run scarfmt decode "$out/toys.scar" "$out/toys.ply" --force

say "How good is each layer, seen from everywhere? (24 views; README's table has other views, and more)"
run scarfmt compare "$scene" "$out/toys.scar" --all-layers

say "Pictures: one row for each layer, then the source"
run scarfmt render "$out/toys.scar" "$out/layers.png" --layers all --views 3 --cameras "$views" --force --quiet
run scarfmt render "$scene" "$out/source.png" --views 3 --cameras "$views" --force --quiet

say "Sizes"
ls -l "$scene" "$out"/*.scar "$out"/*.ply | awk '{ printf "%12s bytes  %s\n", $5, $NF }'
printf '\nLook at %s/layers.png and %s/source.png.\n' "$out" "$out"
