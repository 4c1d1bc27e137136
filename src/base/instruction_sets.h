// Compiles a function for several instruction sets, of which the machine's best runs. For plain
// loops that compilers turn into vector instructions; all give the same bits.
// Clang and the sanitizers compile it once, for any processor: slower, with the same bits.
//
// The kernels of the estimators are not of this kind: they are written in vectors of a width that
// each instruction set has of its own, so that a file per set, with flags of its own and no library
// header, must compile them (see estimation/kernels). Plain loops would gain nothing by that.

#pragma once

#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define RAYLIFT_FOR_EACH_ISA __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define RAYLIFT_FOR_EACH_ISA
#endif
