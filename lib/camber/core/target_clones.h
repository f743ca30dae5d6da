#pragma once

/// Compiles a function twice, for any x86-64 and for a better one (GCC's names: "avx2",
/// "arch=haswell", ...); the program takes one when it starts. Nothing where that is not to be had.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define CAMBER_TARGET_CLONES(better) __attribute__((target_clones(better, "default")))
#else
#define CAMBER_TARGET_CLONES(better)
#endif
