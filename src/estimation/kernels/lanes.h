// The vectors that kernels compute with: 64 bytes of numbers as native vectors of
// RAYLIFT_KERNEL_BYTES bytes, lane by lane. For the files that are compiled once per instruction
// set alone; so everything here has internal linkage, and no library header is used whose inline
// functions could leak instructions that another processor lacks into the rest of the program.
//
// Kernels are flattened, all that they call made part of them: calls would pass vectors through
// memory.

#pragma once

#include "estimation/kernels/kernels.h"

namespace raylift::kernels {
namespace {

// 64 bytes of T as native vectors, with arithmetic lane by lane.
template <typename T>
struct Lanes {
  typedef T Native __attribute__((vector_size(RAYLIFT_KERNEL_BYTES)));
  static constexpr int kParts = 64 / RAYLIFT_KERNEL_BYTES;
  static constexpr int kPartLanes = RAYLIFT_KERNEL_BYTES / sizeof(T);
  Native part[kParts];

  static Lanes Load(const T* values) {
    Lanes r;
    for (int i = 0; i < kParts; ++i) {
      __builtin_memcpy(&r.part[i], values + i * kPartLanes, sizeof(Native));
    }
    return r;
  }
  void Store(T* values) const {
    for (int i = 0; i < kParts; ++i) {
      __builtin_memcpy(values + i * kPartLanes, &part[i], sizeof(Native));
    }
  }
  static Lanes Fill(T value) {
    Lanes r;
    for (int i = 0; i < kParts; ++i) r.part[i] = value - Native{};
    return r;
  }
  // Sums the lanes by halving, in the same order for every width of the native vectors.
  double Sum() const {
    alignas(64) T v[kLanes<T>];
    Store(v);
    for (int width = kLanes<T> / 2; width > 0; width /= 2) {
      for (int i = 0; i < width; ++i) v[i] += v[i + width];
    }
    return static_cast<double>(v[0]);
  }
};

#define RAYLIFT_LANES_OPERATOR(op)                                    \
  template <typename T>                                               \
  inline Lanes<T> operator op(const Lanes<T>& a, const Lanes<T>& b) { \
    Lanes<T> r;                                                       \
    for (int i = 0; i < Lanes<T>::kParts; ++i) {                      \
      r.part[i] = a.part[i] op b.part[i];                             \
    }                                                                 \
    return r;                                                         \
  }
RAYLIFT_LANES_OPERATOR(+)
RAYLIFT_LANES_OPERATOR(-)
RAYLIFT_LANES_OPERATOR(*)
RAYLIFT_LANES_OPERATOR(/)
#undef RAYLIFT_LANES_OPERATOR

// Returns (a < b and c > 0 and d > 0) ? x : y, the one selection that the matches' kernels need.
template <typename T>
inline Lanes<T> SelectInlier(const Lanes<T>& a, const Lanes<T>& b, const Lanes<T>& c,
                             const Lanes<T>& d, const Lanes<T>& x, const Lanes<T>& y) {
  Lanes<T> r;
  for (int i = 0; i < Lanes<T>::kParts; ++i) {
    const typename Lanes<T>::Native zero{};
    r.part[i] =
        ((a.part[i] < b.part[i]) & (c.part[i] > zero) & (d.part[i] > zero)) ? x.part[i] : y.part[i];
  }
  return r;
}

template <typename T>
inline Lanes<T> SquareRoot(const Lanes<T>& a) {
  alignas(64) T v[kLanes<T>];
  a.Store(v);
  for (int i = 0; i < kLanes<T>; ++i) {
    v[i] = sizeof(T) == 4 ? static_cast<T>(__builtin_sqrtf(static_cast<float>(v[i])))
                          : static_cast<T>(__builtin_sqrt(static_cast<double>(v[i])));
  }
  return Lanes<T>::Load(v);
}

template <typename T>
struct Vec3 {
  Lanes<T> x, y, z;
};
template <typename T>
inline Vec3<T> LoadVec3(const T (*rows)[kLanes<T>]) {
  return {Lanes<T>::Load(rows[0]), Lanes<T>::Load(rows[1]), Lanes<T>::Load(rows[2])};
}
template <typename T>
inline Lanes<T> Dot(const Vec3<T>& a, const Vec3<T>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <typename T>
inline Vec3<T> Cross(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <typename T>
inline Vec3<T> Fill3(const T* v) {
  return {Lanes<T>::Fill(v[0]), Lanes<T>::Fill(v[1]), Lanes<T>::Fill(v[2])};
}
template <typename T>
inline Vec3<T> operator+(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <typename T>
inline Vec3<T> operator-(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <typename T>
inline Vec3<T> operator*(const Vec3<T>& a, const Lanes<T>& s) {
  return {a.x * s, a.y * s, a.z * s};
}

// A mask of the lanes that a condition holds for.
struct Mask {
  using Native = long long __attribute__((vector_size(RAYLIFT_KERNEL_BYTES)));
  static constexpr int kParts = Lanes<double>::kParts;
  Native part[kParts];

  friend Mask operator&(const Mask& a, const Mask& b) {
    Mask r;
    for (int i = 0; i < kParts; ++i) r.part[i] = a.part[i] & b.part[i];
    return r;
  }
  friend Mask operator|(const Mask& a, const Mask& b) {
    Mask r;
    for (int i = 0; i < kParts; ++i) r.part[i] = a.part[i] | b.part[i];
    return r;
  }
};
// These compare lane by lane, and are false where one of both is no number.
inline Mask operator<(const Lanes<double>& a, const Lanes<double>& b) {
  Mask r;
  for (int i = 0; i < Mask::kParts; ++i) r.part[i] = a.part[i] < b.part[i];
  return r;
}
inline Mask operator<=(const Lanes<double>& a, const Lanes<double>& b) {
  Mask r;
  for (int i = 0; i < Mask::kParts; ++i) r.part[i] = a.part[i] <= b.part[i];
  return r;
}
inline Lanes<double> Select(const Mask& mask, const Lanes<double>& x, const Lanes<double>& y) {
  Lanes<double> r;
  for (int i = 0; i < Mask::kParts; ++i) r.part[i] = mask.part[i] ? x.part[i] : y.part[i];
  return r;
}
inline bool Any(const Mask& mask) {
  long long any = 0;
  for (int i = 0; i < Mask::kParts; ++i) {
    for (int lane = 0; lane < Lanes<double>::kPartLanes; ++lane) any |= mask.part[i][lane];
  }
  return any != 0;
}
inline Lanes<double> Min(const Lanes<double>& a, const Lanes<double>& b) {
  return Select(a < b, a, b);
}
inline Lanes<double> Max(const Lanes<double>& a, const Lanes<double>& b) {
  return Select(a < b, b, a);
}

// Returns e^x to 1e-12 of it; below -700 as good as 0, above 700 no larger than there.
inline Lanes<double> Exp(const Lanes<double>& x) {
  using L = Lanes<double>;
  const L bounded = Min(Max(x, L::Fill(-700)), L::Fill(700));
  // x = n log 2 + r; this sum has n in its last bits.
  const L shifter = L::Fill(6755399441055744.0);
  const L shifted = bounded * L::Fill(1.4426950408889634) + shifter;
  const L n = shifted - shifter;
  const L r =
      bounded - n * L::Fill(6.93147180369123816490e-01) - n * L::Fill(1.90821492927058770002e-10);
  constexpr double kInverseFactorials[] = {
      1.0 / 3628800, 1.0 / 362880, 1.0 / 40320, 1.0 / 5040, 1.0 / 720, 1.0 / 120,
      1.0 / 24,      1.0 / 6,      0.5,         1,          1};
  L power = L::Fill(kInverseFactorials[0]);
  for (int i = 1; i < 11; ++i) power = power * r + L::Fill(kInverseFactorials[i]);
  for (int i = 0; i < L::kParts; ++i) {
    const auto bits = reinterpret_cast<Mask::Native>(power.part[i]) +
                      (reinterpret_cast<Mask::Native>(shifted.part[i]) << 52);
    power.part[i] = reinterpret_cast<L::Native>(bits);
  }
  return power;
}

// Returns the logarithm of a normal positive number: 2 atanh(f / (2 + f)) for its significand 1 +
// f, and its exponent's part.
inline Lanes<double> Log(const Lanes<double>& x) {
  using L = Lanes<double>;
  using Bits = unsigned long long __attribute__((vector_size(RAYLIFT_KERNEL_BYTES)));
  constexpr unsigned long long kRootOfHalf = 0x3fe6a09e667f3bcd, kOne = 0x3ff0000000000000;
  L exponent, significand;
  for (int i = 0; i < L::kParts; ++i) {
    // The exponent of a significand between the roots of a half and of two, 1023 more than it is.
    const Bits bits = reinterpret_cast<Bits>(x.part[i]) + (kOne - kRootOfHalf);
    exponent.part[i] = reinterpret_cast<L::Native>((bits >> 52) | 0x4330000000000000ULL) -
                       (4503599627370496.0 + 1023);
    significand.part[i] = reinterpret_cast<L::Native>((bits & 0x000fffffffffffffULL) + kRootOfHalf);
  }
  const L f = significand - L::Fill(1);
  const L s = f / (f + L::Fill(2));
  const L z = s * s;
  constexpr double kInverseOdd[] = {2.0 / 15, 2.0 / 13, 2.0 / 11, 2.0 / 9,
                                    2.0 / 7,  2.0 / 5,  2.0 / 3,  2};
  L series = L::Fill(kInverseOdd[0]);
  for (int i = 1; i < 8; ++i) series = series * z + L::Fill(kInverseOdd[i]);
  return exponent * L::Fill(0.693147180559945309) + s * series;
}

}  // namespace
}  // namespace raylift::kernels
