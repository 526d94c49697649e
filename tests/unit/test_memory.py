"""What counts memory: the core's count of device memory, the process's peaks, and how they are said."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

import destello as dl
from destello import _core, memory

COMPILER = os.environ.get("CXX") or shutil.which("g++") or shutil.which("clang++")

# As much of CUDA's run time as device_buffer.h uses, on the host. Memory ends at 1000 bytes.
FAKE_CUDA = """
#pragma once
#include <cstdlib>
#include <cstring>
enum cudaError_t { cudaSuccess, cudaErrorMemoryAllocation };
enum cudaMemcpyKind { cudaMemcpyHostToDevice };
inline cudaError_t cudaGetLastError() { return cudaSuccess; }
inline const char* cudaGetErrorString(cudaError_t) { return "some error"; }
inline cudaError_t cudaMalloc(void** p, size_t n) {
  return n > 1000 ? cudaErrorMemoryAllocation : (*p = std::malloc(n), cudaSuccess);
}
inline cudaError_t cudaMallocHost(void** p, size_t n) { return cudaMalloc(p, n); }
inline cudaError_t cudaFree(void* p) { return std::free(p), cudaSuccess; }
inline cudaError_t cudaFreeHost(void* p) { return cudaFree(p); }
inline cudaError_t cudaMemGetInfo(size_t* free, size_t* total) { return *free = 1, *total = 2, cudaSuccess; }
inline cudaError_t cudaMemcpy(void* to, const void* from, size_t n, cudaMemcpyKind) {
  return std::memcpy(to, from, n), n > 800 ? cudaErrorMemoryAllocation : cudaSuccess;
}
"""

PROGRAM = """
#include "base/device_buffer.h"
#include <cstdio>
using namespace destello;
int failed = 0;
void expect(uint64_t now, uint64_t peak, int line) {
  const MemoryCount& c = device_memory().device;
  if (c.now() == now && c.peak() == peak) return;
  std::printf("line %d: %d now, %d at most\\n", line, int(c.now()), int(c.peak()));
  failed = 1;
}
int main() {
  expect(0, 0, __LINE__);
  {
    DeviceBuffer<float> a(100), none(0), empty;
    expect(400, 400, __LINE__);
    DeviceBuffer<float> b(std::vector<float>(50));
    expect(600, 600, __LINE__);
    DeviceBuffer<float> moved(std::move(a));
    expect(600, 600, __LINE__);
    b = {};
    expect(400, 600, __LINE__);
    moved = DeviceBuffer<float>(25);
    expect(100, 600, __LINE__);
    empty = std::move(moved);
    expect(100, 600, __LINE__);
    try { DeviceBuffer<float> large(1000); failed = 1; } catch (const std::runtime_error&) {}
    try { DeviceBuffer<char> copied(std::vector<char>(900)); failed = 1; } catch (const std::runtime_error&) {}
    expect(100, 1000, __LINE__);
  }
  expect(0, 1000, __LINE__);
  device_memory().device.forget_peak();
  expect(0, 0, __LINE__);
  { PinnedBuffer p(10), q; q = std::move(p); }
  if (device_memory().pinned.now() != 0 || device_memory().pinned.peak() != 80) failed = 1;
  expect(0, 0, __LINE__);
  return failed;
}
"""


@pytest.mark.skipif(not COMPILER, reason="there is no C++ compiler")
def test_buffers_count_what_they_hold(tmp_path):
    """Also through moves and failures: nothing stays counted, nothing is counted twice."""
    (tmp_path / "cuda_runtime.h").write_text(FAKE_CUDA)
    (tmp_path / "program.cpp").write_text(PROGRAM)
    core = Path(__file__).resolve().parents[2] / "core"
    program = tmp_path / "program"
    command = [COMPILER, "-std=c++20", f"-I{tmp_path}", f"-I{core}", tmp_path / "program.cpp", "-o", program]
    subprocess.run([str(word) for word in command], check=True)
    done = subprocess.run([str(program)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_peaks_of_this_process():
    found = memory.peaks()
    assert set(found) == {"peak_host_bytes", "peak_device_bytes", "peak_pinned_bytes"}
    assert found["peak_host_bytes"] > 10 << 20
    counted = _core.device_memory()
    assert counted["device_peak"] >= counted["device"] >= 0
    memory.forget_peaks()
    assert 1 << 20 < memory.peaks()["peak_host_bytes"] <= found["peak_host_bytes"]


@pytest.mark.cuda
def test_a_renders_device_memory_is_counted_and_given_back():
    _core.device_memory(forget_peak=True)
    before = _core.device_memory()["device"]
    scene = dl.scenes.build("mesh1m", 0.05)
    image = dl.render(scene, size=(64, 36), spp=2, device="cuda", progress=False)
    needed = image.metadata["geometry_bytes"] + image.metadata["bvh_bytes"]
    assert image.metadata["peak_device_bytes"] - before >= needed
    assert _core.device_memory()["device"] == before


def test_words():
    assert memory.words(0) == "0 bytes"
    assert memory.words(1536) == "1.5 KiB"
    assert memory.words(3 << 30) == "3.0 GiB"
    assert memory.per_triangle(0, 1, 1) is None
    assert memory.per_triangle(3, 180, 31) == {"geometry": 60.0, "tree": 10.3}
