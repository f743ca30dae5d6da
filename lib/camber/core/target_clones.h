#pragma once

/// Compiles a function twice, for any x86-64 and for one with more instructions ("avx2"); the
/// program takes one when it starts. GCC's "arch=haswell" is taken on that family of processors
/// alone. Nothing where this is not to be had; sanitizers start too late for the choice.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define CAMBER_TARGET_CLONES(better) __attribute__((target_clones(better, "default")))
#else
#define CAMBER_TARGET_CLONES(better)
#endif
