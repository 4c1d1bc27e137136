// Compiles a function for several instruction sets, of which the machine's best runs. For plain
// loops that compilers turn into vector instructions; all give the same bits.
// Clang and the sanitizers compile it once, for any processor: slower, with the same bits.
//
// The kernels of the estimators and of matching are not of this kind: they are written in vectors
// of a width that each instruction set has of its own, so that a file is compiled once per
// SimdLevel, with flags of its own and no library header (raylift_add_kernels in CMake). Plain
// loops would gain nothing by that.

#pragma once

#include <optional>
#include <string_view>

#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define RAYLIFT_FOR_EACH_ISA __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define RAYLIFT_FOR_EACH_ISA
#endif

namespace raylift {

// Returns the best vector instructions of this machine that the libraries tell apart: the last
// digits of what Embree, OpenCV and the C library compute depend on them.
std::string_view VectorInstructions();

enum class SimdLevel { kSse2, kAvx2, kAvx512 };

std::string_view ToString(SimdLevel level);

// Returns whether this processor and this build have it.
bool IsSupported(SimdLevel level);
SimdLevel BestSimdLevel();

// Returns the level of the kernels that are used: the best one, unless a test asked for another.
SimdLevel ActiveSimdLevel();
// Sets the level for tests; nullopt returns to the best level. The level must be supported, and no
// kernel may be in use meanwhile.
void OverrideSimdLevel(std::optional<SimdLevel> level);

}  // namespace raylift
