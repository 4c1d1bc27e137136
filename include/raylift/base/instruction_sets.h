// Compiles a function for several instruction sets, of which the machine's best runs. For plain
// loops that compilers turn into vector instructions; all give the same bits.

#pragma once

#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__)
#define RAYLIFT_FOR_EACH_ISA __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define RAYLIFT_FOR_EACH_ISA
#endif
