#!/usr/bin/env bash
# Everything that wants a GPU, in one go: the CUDA tests, the parity tests, compute-sanitizer on a small scene, the
# benchmarks. Run in the repository's root with destello installed; results go to $OUT (default: build/gpu).
set -uo pipefail
OUT=${OUT:-build/gpu}
mkdir -p "$OUT"
nvidia-smi --query-gpu=name,driver_version,memory.total --format=csv,noheader | tee "$OUT/device.txt"
python3 benches/render.py --device cuda:0 origin:1280x720:200 book1:1200x675:500 book1:1200x800:100 cornell:600x600:200 \
  book2:800x800:64 | tee "$OUT/render.json"
python3 benches/render.py --device cuda:0 --execution fused --repeat 3 origin:1280x720:200 book1:1200x800:100 \
  cornell:600x600:200 | tee "$OUT/fused.json"
sizes="mesh1m:0.001 mesh1m:0.01 mesh1m:0.1 mesh1m mesh1m:10"
python3 benches/rays.py --device cuda --spp 4 $sizes >"$OUT/rays.json"
python3 benches/rays.py --device cuda --spp 8 --build high mesh1m >"$OUT/rays-high.json"
python3 benches/build.py --device cuda --build fast,balanced,high --repeat 2 $sizes >"$OUT/build.json"
python3 -m destello bench --device cuda --json "$OUT/bench.json"
python3 -m pytest -q -m cuda -p no:cacheprovider -W error tests --ignore=tests/io/fuzz -rP --maxfail=20 2>&1 | grep -v "^$" | tail -60 | tee "$OUT/tests.txt"
for tool in memcheck racecheck; do
  for scene in cornell-smoke cornell book1; do  # one for the fused kernel, two for the queue kernels
    compute-sanitizer --tool $tool --error-exitcode 9 python3 -m destello render $scene --size 32x32 --spp 2 \
      --device cuda -o "$OUT/small.png" >"$OUT/$tool-$scene.txt" 2>&1
    echo "$tool, $scene: exit code $?, $(grep -c 'Invalid\|Race' "$OUT/$tool-$scene.txt") reports"
    tail -1 "$OUT/$tool-$scene.txt"
  done
done
