// Finds the real roots of a polynomial of fixed degree, isolated by Sturm's theorem and refined by
// a bracketed Newton iteration, on the stack alone.

#pragma once

#include <array>
#include <cmath>

namespace raylift {

// A polynomial's Sturm chain f_0 = p, f_1 = p', f_{k+2} = (s_k x + o_k) f_{k+1} - f_k, where the
// quotients, and not the members, are stored, so that all members are evaluated from the last one
// up by a three-term recurrence.
template <int kDegree>
class SturmChain {
 public:
  // `p[i]` belongs to x^i; p[kDegree] != 0.
  explicit SturmChain(const std::array<double, kDegree + 1>& p) {
    std::array<double, kDegree + 1> f0 = p;
    std::array<double, kDegree + 1> f1{};
    for (int i = 0; i < kDegree; ++i) {
      f1[i] = p[i + 1] * (i + 1);
    }
    for (int degree = kDegree - 1;; --degree) {  // of f1
      const double slope = f0[degree + 1] / f1[degree];
      const double offset = (f0[degree] - (degree > 0 ? slope * f1[degree - 1] : 0.0)) / f1[degree];
      slope_[length_] = slope;
      offset_[length_] = offset;
      std::array<double, kDegree + 1> f2{};
      double largest = 0;
      for (int i = 0; i < degree; ++i) {
        f2[i] = (i > 0 ? slope * f1[i - 1] : 0.0) + offset * f1[i] - f0[i];
        largest = std::fmax(largest, std::abs(f2[i]));
      }
      // Only signs count: members are scaled so that none over- or underflows.
      rest_[length_] = largest;
      ++length_;
      if (degree == 0 || !(largest > 0)) {
        return;
      }
      for (int i = 0; i < degree; ++i) {
        f2[i] /= largest;
      }
      f0 = f1;
      f1 = f2;
    }
  }

  // Returns the sign changes along the chain at x; less that at y > x, it is the number of distinct
  // roots between.
  int SignChanges(double x) const {
    double next = 0;
    double current = 1;
    int changes = 0;
    for (int k = length_ - 1; k >= 0; --k) {
      const double previous = (slope_[k] * x + offset_[k]) * current - rest_[k] * next;
      changes += std::signbit(previous) != std::signbit(current);
      next = current;
      current = previous;
    }
    return changes;
  }
  int SignChangesAtMinusInfinity() const { return CountSlopes(true); }
  int SignChangesAtInfinity() const { return CountSlopes(false); }

 private:
  int CountSlopes(bool positive) const {
    int count = 0;
    for (int k = 0; k < length_; ++k) {
      count += (slope_[k] > 0) == positive;
    }
    return count;
  }

  std::array<double, kDegree> slope_{};
  std::array<double, kDegree> offset_{};
  std::array<double, kDegree> rest_{};
  int length_ = 0;
};

// Map the whole axis to (-1, 1) and back, so that halving an interval suits roots of any size.
inline double AxisFromUnit(double u) { return u / (1 - std::abs(u)); }
inline double UnitFromAxis(double x) { return x / (1 + std::abs(x)); }

// Returns the only root between a and b, where p changes its sign, by Newton steps, halving where
// they leave the bracket or are slow.
template <int kDegree>
double RefineRoot(const std::array<double, kDegree + 1>& p, double a, double b) {
  const auto halve = [&a, &b] { return AxisFromUnit(0.5 * (UnitFromAxis(a) + UnitFromAxis(b))); };
  double low_value = p[kDegree];
  for (int i = kDegree - 1; i >= 0; --i) {
    low_value = low_value * a + p[i];
  }
  const bool rising = low_value < 0;
  double x = halve();
  double last_step = b - a;
  for (int i = 0; i < 100; ++i) {
    double value = p[kDegree];
    double slope = 0;
    for (int k = kDegree - 1; k >= 0; --k) {
      slope = slope * x + value;
      value = value * x + p[k];
    }
    ((value < 0) == rising ? a : b) = x;
    double next = x - value / slope;
    const bool newton = next > a && next < b && 2 * std::abs(next - x) <= std::abs(last_step);
    if (!newton) {
      next = halve();
    }
    last_step = next - x;
    // Newton's steps converge quadratically: after one of 1e-7 nothing is left to gain.
    if (std::abs(last_step) <= (newton ? 1e-7 : 4e-16) * std::abs(x)) {
      return next;
    }
    x = next;
  }
  return x;
}

// Writes the simple real roots to `roots`, in ascending order, and returns their count (a double
// root may be missed). `p[i]` belongs to x^i. Returns 0 for a polynomial that is not finite or has
// no leading coefficient.
template <int kDegree>
int RealRoots(const std::array<double, kDegree + 1>& p, std::array<double, kDegree>& roots) {
  double sum = 0;
  for (const double c : p) {
    sum += std::abs(c);
  }
  if (!std::isfinite(sum) || !(std::abs(p[kDegree]) > 1e-14 * sum)) {
    return 0;
  }
  const SturmChain<kDegree> chain(p);
  struct Interval {
    double low_u, high_u;
    int low_changes, high_changes;
  };
  const auto value_at = [&p](double x) {
    double value = p[kDegree];
    for (int i = kDegree - 1; i >= 0; --i) {
      value = value * x + p[i];
    }
    return value;
  };
  constexpr double kOuter = 1 - 1e-7;
  constexpr int kMaxDepth = 40;
  std::array<Interval, kMaxDepth + 2> stack;
  int depth = 0;
  stack[depth++] = {-kOuter, kOuter, chain.SignChangesAtMinusInfinity(),
                    chain.SignChangesAtInfinity()};
  int count = 0;
  while (depth > 0 && count < kDegree) {
    const Interval interval = stack[--depth];
    const int inside = interval.low_changes - interval.high_changes;
    if (inside <= 0) {
      continue;
    }
    const double a = AxisFromUnit(interval.low_u);
    const double b = AxisFromUnit(interval.high_u);
    if (inside == 1 && (value_at(a) < 0) != (value_at(b) < 0)) {
      roots[count++] = RefineRoot<kDegree>(p, a, b);
      continue;
    }
    if (depth >= kMaxDepth || interval.high_u - interval.low_u < 1e-11) {
      continue;  // a multiple root
    }
    const double middle_u = 0.5 * (interval.low_u + interval.high_u);
    const int middle_changes = chain.SignChanges(AxisFromUnit(middle_u));
    stack[depth++] = {middle_u, interval.high_u, middle_changes, interval.high_changes};
    stack[depth++] = {interval.low_u, middle_u, interval.low_changes, middle_changes};
  }
  return count;
}

}  // namespace raylift
