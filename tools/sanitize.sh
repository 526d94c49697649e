#!/usr/bin/env bash
# Builds the core with sanitizers (CPU only) in build/sanitize-* and runs the tests named, or those of the core, with it.
#   SANITIZE=address,undefined | thread   JOBS=2   VENV=.venv-test   tools/sanitize.sh [pytest arguments]
# The environment must not hold an editable destello: its import hook would win over the folder built here.
set -euo pipefail
cd "$(dirname "$0")/.."
bin=$PWD/${VENV:-.venv-test}/bin
sanitize=${SANITIZE:-address,undefined}
build=build/sanitize-${sanitize%%,*}
mkdir -p build

"$bin/cmake" -S . -B "$build" -G Ninja -DCMAKE_MAKE_PROGRAM="$bin/ninja" -DCMAKE_BUILD_TYPE=Release \
  -DPython_EXECUTABLE="$bin/python" -DDST_CUDA=OFF -DDST_SANITIZE="$sanitize" >"$build.log" 2>&1 ||
  { cat "$build.log"; exit 1; }
"$bin/cmake" --build "$build"

rm -rf "$build/site"
"$bin/cmake" --install "$build" --prefix "$build/site" >/dev/null
cp -r src/destello "$build/site/"

# The interpreter is not instrumented, so the run times must be there first; it keeps its objects at exit, so leaks say nothing.
cxx=$(sed -n 's/^CMAKE_CXX_COMPILER:[A-Z]*=//p' "$build/CMakeCache.txt")
runtime=asan
[ "$sanitize" != thread ] || runtime=tsan
export LD_PRELOAD="$("$cxx" -print-file-name=lib$runtime.so) $("$cxx" -print-file-name=libstdc++.so)"
# A malloc that asks for more than there is gets null, as without sanitizers: tinyvdb asks for what damaged files say.
export ASAN_OPTIONS=detect_leaks=0:detect_odr_violation=0:allocator_may_return_null=1 UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1
export TSAN_OPTIONS=suppressions=$PWD/tools/tsan.supp
export PYTHONPATH=$PWD/$build/site DESTELLO_SANITIZE=$sanitize

"$bin/python" -c "import destello._core as core; assert '$build/' in core.__file__, core.__file__"
[ $# -gt 0 ] || set -- tests/unit
[ -e "${1%%::*}" ] || { echo "sanitize: no $1 yet: the module loads, nothing else was run"; exit 0; }
# Open Image Denoise brings a threading run time that does not live with the sanitizers', and none of it is our code.
exec "$bin/python" -m pytest -p no:cacheprovider -n "${JOBS:-2}" -q \
  -m "not slow and not cuda and not mitsuba" -k "not denoise" "$@"
