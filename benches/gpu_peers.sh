#!/usr/bin/env bash
# destello beside Mitsuba 3 and Warp on one GPU, in one run, from nothing: makes the build, unpacks the peers, measures.
#
#   benches/gpu_peers.sh warp        # rays alone: mesh1m, 16 camera rays a pixel
#   benches/gpu_peers.sh mitsuba     # whole renders
#
# Run in the repository's root. $PEERS (default: .peers) holds warp.tar.xz and mitsuba.tar.xz: what `pip install --target`
# makes of warp-lang==1.19.0, and of mitsuba==3.9.1 with drjit==1.5.0; where they are missing, those that Python finds are
# taken. JSON goes to $OUT (default: build/gpu). $SITE (default: build/site) gets destello unless Python finds one.
# SPP, RAY_SPP and REPEAT: samples a pixel of renders (256), camera rays a pixel (16), runs that count (5).
set -uo pipefail
OUT=${OUT:-build/gpu} PEERS=${PEERS:-.peers} SITE=${SITE:-build/site}
SPP=${SPP:-256} RAY_SPP=${RAY_SPP:-16} REPEAT=${REPEAT:-5}
mkdir -p "$OUT" "$SITE"
SITE=$(realpath "$SITE")
for name in "$@"; do
  if [ -f "$PEERS/$name.tar.xz" ]; then tar xJf "$PEERS/$name.tar.xz" -C "$SITE" || exit 1; fi
done
export PYTHONPATH=$SITE${PYTHONPATH:+:$PYTHONPATH}
if ! python3 -c 'import sys, destello._core as core; sys.exit(not core.has_cuda)' 2>/dev/null; then
  cmake -S . -B "$SITE/.build" -G Ninja -DSKBUILD_PROJECT_VERSION=0.1.0 -DDST_CUDA=ON -DCMAKE_CUDA_ARCHITECTURES=90-real \
    -DPython_EXECUTABLE="$(command -v python3)" >"$OUT/build.log" 2>&1 &&
    cmake --build "$SITE/.build" --target _core -j "$(nproc)" >>"$OUT/build.log" 2>&1 || { tail -30 "$OUT/build.log"; exit 1; }
  mkdir -p "$SITE/destello" && cp -r src/destello/. "$SITE/.build"/_core*.so "$SITE/destello/"
fi
nvidia-smi --query-gpu=name,driver_version,memory.total --format=csv,noheader | tee "$OUT/device.txt"
for name in "$@"; do
  case $name in
    warp) python3 benches/peers.py --device cuda --only rays --ray-spp "$RAY_SPP" --repeat "$REPEAT" mesh1m >"$OUT/peers-rays.json" ;;
    mitsuba)
      python3 benches/peers.py --device cuda --only renders --spp "$SPP" --repeat "$REPEAT" --timeout 120 \
        book1 cornell:1:1024x1024 mesh1m interior instances-100 >"$OUT/peers-renders.json"
      python3 benches/peers.py --device cuda --only renders --spp "$SPP" --repeat "$REPEAT" --peers "destello,destello mis" instances \
        >>"$OUT/peers-renders.json"
      ;;
    *) echo "gpu_peers.sh: $name: expected warp or mitsuba" >&2; exit 2 ;;
  esac
done
