// The only header that looks at the compiler. Everything else says DST_HD / DST_FN.
#pragma once

#include <cstdint>

#if defined(__CUDACC__)
// Marks member functions that run on host and device.
#define DST_HD __host__ __device__
#else
#define DST_HD
#endif

// Marks free functions that run on host and device.
#define DST_FN DST_HD inline

// After DST_HD or DST_FN: code off the hot path or used in many places, kept out of line on the device. A kernel that inlines everything outgrows
// the instruction cache, and then waits for instructions most of the time (benches/LOG.md).
#if defined(__CUDACC__)
#define DST_COLD __noinline__
#else
#define DST_COLD
#endif

// Before small functions of the hot path: inlined wherever they are called on the host, whatever the compiler counts.
#if defined(__CUDACC__)
#define DST_HOT
#else
#define DST_HOT __attribute__((always_inline))
#endif

// Marks free functions that run on host and device and are big and rarely needed: one copy, called.
#if defined(__CUDACC__)
#define DST_NOINLINE __host__ __device__ __noinline__ inline
#else
#define DST_NOINLINE __attribute__((noinline)) inline
#endif

// True while compiling device machine code.
#if defined(__CUDA_ARCH__)
#define DST_ON_DEVICE 1
#else
#define DST_ON_DEVICE 0
#endif

// Before a short loop with constant bounds: unroll it whole.
#if defined(__CUDACC__)
#define DST_UNROLL _Pragma("unroll")
#else
#define DST_UNROLL _Pragma("GCC unroll 8")
#endif

// True where the compiler for the host knows GCC's vector types and has SSE2 to run them on.
#if !defined(__CUDACC__) && defined(__SSE2__)
#define DST_HOST_SIMD 1
#else
#define DST_HOST_SIMD 0
#endif
