#include "camber/scale/road_edge_detection.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

#include "camber/core/threads.h"

namespace camber {
namespace {

constexpr double kNearest = 4.0, kFarthest = 80.0;  // m
constexpr double kWindow = 0.8;                     // m of mask on both sides
constexpr int kStride = 2;           // px between the columns in which a mask is followed
constexpr int kMostStep = 24;        // px by which an edge moves from row to row
constexpr float kLeastStep = 0.55F;  // of the mask over the windows, of 1
constexpr float kNever = -1e9F;
constexpr double kMaskSigma = 6.0;  // px, by which a mask's edge is off
constexpr double kSample = 0.025;   // m between samples across an edge
constexpr int kReach = 24;          // samples by which the coarse place may be off
constexpr int kHalf = 24;           // samples to each side of a cross section
constexpr int kMove = 3;            // samples from row to row
constexpr float kTexture = 2.0F;    // intensity: fainter cross sections are like nothing
constexpr float kLeastLikeness = 0.6F;
constexpr int kBridged = 4;  // rows in a row that may be unlike the others
constexpr int kFewest = 12;  // rows of an edge

/// Coarse edge: one entry a row in reach, the topmost first.
struct Path {
  std::vector<double> column;
  std::vector<float> step;  // of the mask there
};

class EdgeFinder {
 public:
  EdgeFinder(const GrayImage& image, const PinholeCamera& camera, const GroundRaster& ground,
             const std::vector<std::uint8_t>& road, const std::vector<std::uint8_t>& hidden,
             const Eigen::Vector3d& ahead)
      : image_(image),
        camera_(camera),
        ground_(ground),
        road_(road),
        hidden_(hidden),
        right_(Eigen::Vector3d(0, 1, 0).cross(ahead).normalized()) {
    // Rows whose ground lies in reach at the middle of the image.
    bottom_ = camera.height - 1;
    top_ = bottom_ + 1;
    for (int v = bottom_; v >= ground.top; --v) {
      if (!(middle(v) > 1.0 / kFarthest)) break;
      top_ = v;
    }
    while (bottom_ > top_ && middle(bottom_) > 1.0 / kNearest) --bottom_;
  }

  int rows() const { return std::max(0, bottom_ - top_ + 1); }

  std::vector<RoadEdgePixel> find(int side) const {
    return rows() < kFewest ? std::vector<RoadEdgePixel>()
                            : follow_section(smooth(follow_mask(side)));
  }

 private:
  double inverse_depth_near(double u, double v) const {
    const int x = std::clamp(static_cast<int>(std::lround(u)), 0, camera_.width - 1);
    const int y = std::clamp(static_cast<int>(std::lround(v)), ground_.top, camera_.height - 1);
    return ground_.inverse_depth[static_cast<std::size_t>(y - ground_.top) *
                                     static_cast<std::size_t>(camera_.width) +
                                 static_cast<std::size_t>(x)];
  }
  double inverse_depth(int u, int v) const {
    return ground_.inverse_depth[static_cast<std::size_t>(v - ground_.top) *
                                     static_cast<std::size_t>(camera_.width) +
                                 static_cast<std::size_t>(u)];
  }
  double middle(int v) const { return inverse_depth(camera_.width / 2, v); }

  /// Columns by which a line along the road moves from row v to row v - 1, at a depth.
  double slope(int u, int v) const {
    const double here = inverse_depth(u, v), above = inverse_depth(u, v - 1);
    if (!(here > 1.0 / kFarthest) || !(above > 0.5 / kFarthest)) return 0.0;
    const auto column = static_cast<double>(u);
    const Eigen::Vector3d a = camera_.ray({column, static_cast<double>(v)}) / here;
    const Eigen::Vector3d b = camera_.ray({column, v - 1.0}) / above;
    return -(b - a).dot(right_) * camera_.fx * above / std::max(0.2, right_.x());
  }

  Path follow_mask(int side) const {
    const int width = camera_.width;
    const auto columns = static_cast<std::size_t>(width);
    const int count = rows();
    std::vector<float> steps(columns * static_cast<std::size_t>(count));
    std::vector<std::int16_t> from(steps.size());
    std::vector<float> best(columns, kNever), next(columns, kNever);
    std::vector<int> sum(columns + 1), known(columns + 1);
    for (int v = bottom_; v >= top_; --v) {
      const std::size_t row = static_cast<std::size_t>(v) * columns;
      sum[0] = known[0] = 0;
      for (std::size_t u = 0; u < columns; ++u) {
        const bool seen = hidden_[row + u] == 0;
        sum[u + 1] = sum[u] + (seen ? (road_[row + u] ? 1 : -1) : 0);
        known[u + 1] = known[u] + (seen ? 1 : 0);
      }
      float* step = &steps[columns * static_cast<std::size_t>(v - top_)];
      std::int16_t* back = &from[columns * static_cast<std::size_t>(v - top_)];
      for (int u = 0; u < width; u += kStride) {
        const double rho = inverse_depth(u, v);
        float s = 0.0F;
        const int window =
            std::clamp(static_cast<int>(std::lround(kWindow * camera_.fx * rho)), 3, 60);
        if (rho > 1.0 / kFarthest && u - window >= 0 && u + window <= width) {
          const auto a = static_cast<std::size_t>(u - window), b = static_cast<std::size_t>(u),
                     c = static_cast<std::size_t>(u + window);
          const int seen = std::min(known[b] - known[a], known[c] - known[b]);
          if (10 * seen >= 7 * window) {
            s = static_cast<float>(side * (sum[c] - 2 * sum[b] + sum[a])) /
                static_cast<float>(2 * window);
          }
        }
        step[u] = std::clamp(s, 0.0F, 1.0F);
        if (v == bottom_) {
          next[static_cast<std::size_t>(u)] = step[u];
          back[u] = 0;
          continue;
        }
        // Along the road, whose direction may differ by 0.15 rad from that ahead.
        const double below = inverse_depth(u, v + 1);
        const double ahead =
            below > 0 && rho > 0 ? std::clamp(1.0 / rho - 1.0 / below, 0.0, 8.0) : 0.0;
        const auto tolerance = static_cast<float>(1.0 + 0.15 * ahead * camera_.fx * rho);
        const auto expected =
            static_cast<float>(std::clamp(slope(u, v + 1), 4.0 - kMostStep, kMostStep - 4.0));
        const int reach = kStride * (static_cast<int>(4.0F * tolerance / kStride) + 1);
        const int middle = kStride * static_cast<int>(std::lround(-expected / kStride));
        float most = kNever;
        int chosen = 0;
        for (int k = std::max(-kMostStep, middle - reach); k <= std::min(kMostStep, middle + reach);
             k += kStride) {
          const int w = u + k;  // in the row below
          if (w < 0 || w >= width) continue;
          const float off = (static_cast<float>(-k) - expected) / tolerance;
          const float value =
              best[static_cast<std::size_t>(w)] - 0.125F * std::min(off * off, 16.0F);
          if (value > most) {
            most = value;
            chosen = k;
          }
        }
        next[static_cast<std::size_t>(u)] = most + step[u];
        back[u] = static_cast<std::int16_t>(chosen);
      }
      std::swap(best, next);
    }
    Path out;
    int u = static_cast<int>(std::max_element(best.begin(), best.end()) - best.begin());
    for (int v = top_; v <= bottom_; ++v) {
      const std::size_t i =
          columns * static_cast<std::size_t>(v - top_) + static_cast<std::size_t>(u);
      out.column.push_back(u - 0.5);
      out.step.push_back(steps[i]);
      u = std::clamp(u + from[i], 0, width - 1);
    }
    return out;
  }

  float intensity(double u, double v) const {
    const double x = std::clamp(u, 0.0, image_.width - 1.001);
    const double y = std::clamp(v, 0.0, image_.height - 1.001);
    const int i = static_cast<int>(x), j = static_cast<int>(y);
    const auto a = static_cast<float>(x - i), b = static_cast<float>(y - j);
    const std::uint8_t* p = image_.row(j);
    const std::uint8_t* q = image_.row(j + 1);
    return (1 - b) * ((1 - a) * p[i] + a * p[i + 1]) + b * ((1 - a) * q[i] + a * q[i + 1]);
  }

  /// The coarse path without the mask's raggedness.
  struct Base {
    std::vector<double> column;
    std::vector<double> lean;   // columns a row down
    std::vector<double> scale;  // px a metre
    std::vector<char> usable;   // the mask changes over there
    std::size_t size() const { return column.size(); }
  };

  /// Lines over 15 rows around each one, reweighted.
  Base smooth(const Path& coarse) const {
    constexpr std::size_t kAround = 7;
    const std::size_t count = coarse.column.size();
    Base out{coarse.column, std::vector<double>(count, 0.0), std::vector<double>(count),
             std::vector<char>(count, 0)};
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t a = i >= kAround ? i - kAround : 0, b = std::min(count - 1, i + kAround);
      std::array<double, 2 * kAround + 1> weight;
      weight.fill(1.0);
      const auto rows_off = [&](std::size_t k) {
        return static_cast<double>(k) - static_cast<double>(i);
      };
      Eigen::Vector2d x(coarse.column[i], 0.0);
      int used = 0;
      for (int round = 0; round < 4; ++round) {
        Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
        Eigen::Vector2d side = Eigen::Vector2d::Zero();
        used = 0;
        for (std::size_t k = a; k <= b; ++k) {
          if (coarse.step[k] < kLeastStep) continue;
          const Eigen::Vector2d basis(1.0, rows_off(k));
          normal += weight[k - a] * basis * basis.transpose();
          side += weight[k - a] * coarse.column[k] * basis;
          ++used;
        }
        if (used < 4) break;
        x = normal.ldlt().solve(side);
        for (std::size_t k = a; k <= b; ++k) {
          const double off = coarse.column[k] - x[0] - x[1] * rows_off(k);
          weight[k - a] = 1.0 / (1.0 + 0.25 * off * off);
        }
      }
      if (used >= 4 && coarse.step[i] >= kLeastStep) {
        out.column[i] = x[0];
        out.lean[i] = std::clamp(x[1], -20.0, 20.0);
        out.usable[i] = 1;
      }
      const double rho = inverse_depth_near(out.column[i], top_ + static_cast<double>(i));
      out.scale[i] = camera_.fx * std::max(rho, 0.5 / kFarthest);
    }
    return out;
  }

  /// Brightening to the right, kSample apart across the edge and beyond; intensity.
  static constexpr int kSamples = 2 * (kReach + kHalf) + 1;
  using Section = std::array<float, kSamples>;
  std::vector<Section> sections(const Base& base) const {
    std::vector<Section> out(base.size());
    for (std::size_t i = 0; i < base.size(); ++i) {
      out[i].fill(0.0F);
      if (!base.usable[i]) continue;
      const double half = std::max(0.06 * base.scale[i], 1.2);  // px
      const int taps = std::clamp(static_cast<int>(std::ceil(half)), 2, 12);
      for (int j = 0; j < kSamples; ++j) {
        const double u = base.column[i] + kSample * base.scale[i] * (j - kReach - kHalf);
        float value = 0.0F;
        for (int dv = -1; dv <= 1; ++dv) {
          const double x = u + base.lean[i] * dv, v = top_ + static_cast<double>(i) + dv;
          for (int k = 0; k < taps; ++k) {
            const double off = half * (k + 0.5) / taps;
            value += intensity(x + off, v) - intensity(x - off, v);
          }
        }
        out[i][static_cast<std::size_t>(j)] =
            std::clamp(value / static_cast<float>(3 * taps), -60.0F, 60.0F);
      }
    }
    return out;
  }

  /// Values of the places of an edge in each row, kSample apart, and the best path through them.
  static constexpr int kStates = 2 * kReach + 1;
  using Values = std::vector<std::array<float, kStates>>;
  static std::vector<int> best_path(const Values& value, float* total) {
    const std::size_t count = value.size();
    std::vector<std::array<std::int8_t, kStates>> back(count);
    std::array<float, kStates> best = value[count - 1], next;
    for (std::size_t i = count - 1; i-- > 0;) {
      for (int s = 0; s < kStates; ++s) {
        float most = -1e9F;
        int chosen = 0;
        for (int k = -kMove; k <= kMove; ++k) {
          if (s + k < 0 || s + k >= kStates) continue;
          const float x = best[static_cast<std::size_t>(s + k)] - 0.1F * static_cast<float>(k * k);
          if (x > most) {
            most = x;
            chosen = k;
          }
        }
        next[static_cast<std::size_t>(s)] = most + value[i][static_cast<std::size_t>(s)];
        back[i][static_cast<std::size_t>(s)] = static_cast<std::int8_t>(chosen);
      }
      best = next;
    }
    std::vector<int> path(count);
    auto s = static_cast<int>(std::max_element(best.begin(), best.end()) - best.begin());
    *total = best[static_cast<std::size_t>(s)];
    for (std::size_t i = 0; i < count; ++i) {
      path[i] = s;
      if (i + 1 < count) s += back[i][static_cast<std::size_t>(s)];
    }
    return path;
  }

  /// Values by `of`(row, place); hidden rows take no part.
  template <class Of>
  static Values values(const Base& base, const Of& of) {
    Values out(base.size());
    for (std::size_t i = 0; i < base.size(); ++i) {
      for (int s = 0; s < kStates; ++s) {
        const double px = kSample * base.scale[i] * (s - kReach) / kMaskSigma;
        out[i][static_cast<std::size_t>(s)] =
            base.usable[i] ? of(i, s) - static_cast<float>(0.1 * px * px) : 0.0F;
      }
    }
    return out;
  }

  std::vector<RoadEdgePixel> follow_section(const Base& base) const {
    const std::size_t count = base.size();
    const std::vector<Section> seen = sections(base);
    // First by the strongest edge of either sign, then by the likeness to the mean cross section.
    std::vector<int> path;
    float most = -1e9F;
    for (const float sign : {1.0F, -1.0F}) {
      float total = 0.0F;
      std::vector<int> found =
          best_path(values(base,
                           [&](std::size_t i, int s) {
                             const float edge = seen[i][static_cast<std::size_t>(s + kHalf)];
                             return 0.1F * std::clamp(sign * edge, -5.0F, 40.0F);
                           }),
                    &total);
      if (total > most) {
        most = total;
        path = std::move(found);
      }
    }
    constexpr int kWide = 2 * kHalf + 1;
    std::array<float, kWide> usual;
    const auto likeness = [&](std::size_t i, int s) {
      float both = 0.0F, own = 0.0F, other = 1e-3F;
      for (int j = 0; j < kWide; ++j) {
        const float a = seen[i][static_cast<std::size_t>(s + j)];
        const float b = usual[static_cast<std::size_t>(j)];
        both += a * b;
        own += a * a;
        other += b * b;
      }
      return both / std::sqrt(std::max(own, kTexture * kTexture * kWide) * other);
    };
    for (int round = 0; round < 3; ++round) {
      usual.fill(0.0F);
      int used = 0;
      for (std::size_t i = 0; i < count; ++i) {
        if (!base.usable[i]) continue;
        ++used;
        for (int j = 0; j < kWide; ++j) {
          usual[static_cast<std::size_t>(j)] +=
              std::clamp(seen[i][static_cast<std::size_t>(path[i] + j)], -30.0F, 30.0F);
        }
      }
      if (used < kFewest) return {};
      for (float& x : usual) x /= static_cast<float>(used);
      float total = 0.0F;
      path = best_path(values(base, [&](std::size_t i, int s) { return 3.0F * likeness(i, s); }),
                       &total);
    }
    std::vector<RoadEdgePixel> out;
    for (std::size_t i = count; i-- > 0;) {
      const int s = path[i], v = top_ + static_cast<int>(i);
      if (!base.usable[i] || s == 0 || s == kStates - 1) continue;
      const float before = likeness(i, s - 1), here = likeness(i, s), after = likeness(i, s + 1);
      if (here < kLeastLikeness) continue;
      const float bend = before - 2.0F * here + after;
      const double shift = bend < 0 ? std::clamp(0.5 * (before - after) / bend, -1.0, 1.0) : 0.0;
      out.push_back({v, base.column[i] + kSample * base.scale[i] * (s - kReach + shift),
                     !out.empty() && out.back().row - v <= kBridged + 1});
    }
    return out;
  }

  const GrayImage& image_;
  const PinholeCamera& camera_;
  const GroundRaster& ground_;
  const std::vector<std::uint8_t>& road_;
  const std::vector<std::uint8_t>& hidden_;
  Eigen::Vector3d right_;
  int top_ = 0, bottom_ = 0;
};

}  // namespace

RoadEdges detect_road_edges(const GrayImage& image, const PinholeCamera& camera,
                            const GroundRaster& ground, const std::vector<std::uint8_t>& road,
                            const std::vector<std::uint8_t>& hidden, const Eigen::Vector3d& ahead,
                            int num_threads) {
  const std::size_t total =
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  if (image.width != camera.width || image.height != camera.height || road.size() != total ||
      hidden.size() != total || ground.top < 0 ||
      ground.inverse_depth.size() !=
          total - static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(ground.top)) {
    throw std::invalid_argument("road edges: image, masks and ground differ in size");
  }
  const EdgeFinder finder(image, camera, ground, road, hidden, ahead);
  RoadEdges out;
  parallel_for(2, num_threads, [&](std::size_t side) {
    (side == 0 ? out.left : out.right) = finder.find(side == 0 ? 1 : -1);
  });
  return out;
}

}  // namespace camber
