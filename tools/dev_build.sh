#!/usr/bin/env bash
# (Re)builds the editable install in $VENV: the first time through pip, after that with CMake alone, which takes seconds.
# DST_CUDA=OFF|ON: each has a build folder of its own. One build at a time, however many people share the checkout.
set -euo pipefail
cd "$(dirname "$0")/.."
bin=$PWD/${VENV:-.venv}/bin
cuda=${DST_CUDA:-OFF}
build=build/dev
[ "$cuda" = OFF ] || build=build/dev-cuda

mkdir -p build
exec 9>build/.lock
flock 9

if [ -f "$build/CMakeCache.txt" ] && "$bin/python" -c 'import destello._core' 2>/dev/null; then
  "$bin/cmake" --build "$build"
  site=$("$bin/python" -c 'import sysconfig; print(sysconfig.get_path("platlib"))')
  "$bin/cmake" --install "$build" --prefix "$site" >/dev/null
else
  "$bin/pip" install -q --no-build-isolation --no-deps -e . -C cmake.define.DST_CUDA="$cuda" -C build-dir="$build"
fi
