#include "camber/detect/keypoint_evaluation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <stdexcept>

namespace camber {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kPi = 3.14159265358979323846;
constexpr double kNear = 2.0;   // px of 64
constexpr double kAlpha = 0.1;  // of the box's larger side

/// A keypoint of a crop against its truth.
struct Judged {
  std::size_t crop = 0;
  int keypoint = 0;
  Eigen::Vector2d error = Eigen::Vector2d::Zero();  // px of the crop
  double sigma = 0.0, probability = 0.0, box_side = 0.0;
  bool visible = false, inside = false;

  bool right() const { return error.norm() <= kAlpha * box_side; }
};

std::vector<Judged> judge(const std::vector<KeypointCropTruth>& crops,
                          const std::vector<PredictedKeypoints>& predicted) {
  std::vector<Judged> out;
  out.reserve(crops.size() * kNumKeypoints);
  for (std::size_t i = 0; i < crops.size(); ++i) {
    const double last = kKeypointCropSize - 0.5;
    for (std::size_t k = 0; k < kNumKeypoints; ++k) {
      const Eigen::Vector2d& truth = crops[i].points[k];
      const PredictedKeypoint& found = predicted[i][k];
      Judged j;
      j.crop = i;
      j.keypoint = static_cast<int>(k);
      j.error = found.at - truth;
      j.sigma = found.sigma;
      j.probability = found.visible;
      j.box_side = crops[i].box_side;
      j.visible = crops[i].visibility[k] == KeypointVisibility::kVisible;
      j.inside = (truth.array() >= -0.5).all() && (truth.array() <= last).all();
      out.push_back(j);
    }
  }
  return out;
}

/// The value in the middle, or the mean of the two there; reorders.
double median(std::vector<double>* values) {
  if (values->empty()) return kNaN;
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  if (values->size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values->begin(), middle));
}

using Choice = std::function<bool(const Judged&)>;

KeypointErrors errors_of(const std::vector<Judged>& judged, const Choice& chosen) {
  KeypointErrors out;
  double near = 0.0, right = 0.0;
  std::array<double, 3> inside = {};
  std::vector<double> distances, u, v;
  for (const Judged& j : judged) {
    if (!j.inside || !chosen(j)) continue;
    ++out.count;
    distances.push_back(j.error.norm());
    u.push_back(j.error.x());
    v.push_back(j.error.y());
    near += j.error.norm() <= kNear ? 1.0 : 0.0;
    right += j.right() ? 1.0 : 0.0;
    for (std::size_t s = 0; s < inside.size(); ++s) {
      const double reach = static_cast<double>(s + 1) * j.sigma;
      inside[s] += 0.5 * ((std::abs(j.error.x()) <= reach ? 1.0 : 0.0) +
                          (std::abs(j.error.y()) <= reach ? 1.0 : 0.0));
    }
  }
  const double count = out.count > 0 ? static_cast<double>(out.count) : kNaN;
  out.pck_2px = near / count;
  out.pck_alpha = right / count;
  out.median = median(&distances);
  out.offset = {median(&u), median(&v)};
  for (std::size_t s = 0; s < inside.size(); ++s) out.inside_sigmas[s] = inside[s] / count;
  return out;
}

KeypointGroup group_of(const std::string& name, const std::vector<Judged>& judged,
                       const Choice& chosen) {
  return {name, errors_of(judged, [&](const Judged& j) { return chosen(j) && j.visible; }),
          errors_of(judged, [&](const Judged& j) { return chosen(j) && !j.visible; }),
          errors_of(judged, chosen)};
}

/// KeypointEvaluation::apk of one keypoint.
double average_precision(const std::vector<Judged>& judged, int keypoint) {
  std::vector<const Judged*> ranked;
  double positives = 0.0;
  for (const Judged& j : judged) {
    if (j.keypoint != keypoint) continue;
    ranked.push_back(&j);
    positives += j.visible && j.inside ? 1.0 : 0.0;
  }
  if (positives == 0.0) return kNaN;
  std::stable_sort(ranked.begin(), ranked.end(), [](const Judged* a, const Judged* b) {
    return a->probability > b->probability;
  });
  std::vector<double> precision, recall;
  double found = 0.0;
  for (std::size_t i = 0; i < ranked.size(); ++i) {
    const Judged& j = *ranked[i];
    found += j.visible && j.inside && j.right() ? 1.0 : 0.0;
    precision.push_back(found / static_cast<double>(i + 1));
    recall.push_back(found / positives);
  }
  double area = 0.0, best = 0.0;
  for (std::size_t i = ranked.size(); i-- > 0;) {
    best = std::max(best, precision[i]);
    area += best * (recall[i] - (i > 0 ? recall[i - 1] : 0.0));
  }
  return area;
}

std::vector<KeypointGroup> groups_by_height(const std::vector<KeypointCropTruth>& crops,
                                            const std::vector<Judged>& judged) {
  constexpr double kEdges[] = {0.0, 20.0, 40.0, 80.0, 160.0, 1e9};  // px
  std::vector<KeypointGroup> out;
  for (std::size_t b = 0; b + 1 < std::size(kEdges); ++b) {
    const double low = kEdges[b], high = kEdges[b + 1];
    const std::string name = b + 2 < std::size(kEdges) ? fmt::format("{} to {} px", low, high)
                                                       : fmt::format("from {} px", low);
    out.push_back(group_of(name, judged, [&](const Judged& j) {
      return crops[j.crop].box_height >= low && crops[j.crop].box_height < high;
    }));
  }
  return out;
}

std::vector<KeypointGroup> groups_by_heading(const std::vector<KeypointCropTruth>& crops,
                                             const std::vector<Judged>& judged) {
  constexpr std::array<const char*, 8> kNames = {"right", "rear right", "rear",  "rear left",
                                                 "left",  "front left", "front", "front right"};
  std::vector<KeypointGroup> out;
  for (std::size_t sector = 0; sector < kNames.size(); ++sector) {
    out.push_back(group_of(kNames[sector], judged, [&](const Judged& j) {
      const double eighths = crops[j.crop].azimuth / (0.25 * kPi);
      const auto nearest = static_cast<long>(std::lround(eighths));
      return ((nearest % 8) + 8) % 8 == static_cast<long>(sector);
    }));
  }
  return out;
}

std::string percent(double share) {
  return std::isfinite(share) ? fmt::format("{:.1f}", 100.0 * share) : "-";
}

std::string row(const KeypointGroup& g) {
  const auto number = [](double value) {
    return std::isfinite(value) ? fmt::format("{:.2f}", value) : std::string("-");
  };
  return fmt::format("{:<28} {:>8} {:>7} {:>7} {:>7} {:>7} {:>7} {:>6} {:>6} {:>6} {:>6}\n", g.name,
                     g.all.count, percent(g.visible.pck_2px), percent(g.hidden.pck_2px),
                     percent(g.all.pck_2px), percent(g.visible.pck_alpha), percent(g.all.pck_alpha),
                     number(g.visible.median), number(g.visible.offset.x()),
                     number(g.visible.offset.y()), percent(g.visible.inside_sigmas[1]));
}

}  // namespace

const std::array<const char*, kNumKeypoints / 2>& keypoint_part_names() {
  static const std::array<const char*, kNumKeypoints / 2> names = {"rear wheel",
                                                                   "front wheel",
                                                                   "front arch, front",
                                                                   "front arch, upper front",
                                                                   "front arch, upper rear",
                                                                   "front arch, rear",
                                                                   "rear arch, front",
                                                                   "rear arch, upper front",
                                                                   "rear arch, upper rear",
                                                                   "rear arch, rear",
                                                                   "rear bumper",
                                                                   "boot",
                                                                   "rear window",
                                                                   "roof, rear",
                                                                   "roof, front",
                                                                   "windscreen",
                                                                   "bonnet",
                                                                   "front bumper"};
  return names;
}

KeypointEvaluation evaluate_keypoints(const std::vector<KeypointCropTruth>& crops,
                                      const std::vector<PredictedKeypoints>& predicted) {
  if (crops.size() != predicted.size()) {
    throw std::invalid_argument(fmt::format("evaluate_keypoints: {} crops and {} predictions",
                                            crops.size(), predicted.size()));
  }
  const std::vector<Judged> judged = judge(crops, predicted);
  KeypointEvaluation out;
  out.crops = crops.size();
  out.overall = group_of("all", judged, [](const Judged&) { return true; });
  double apk = 0.0, keypoints = 0.0;
  for (int k = 0; k < kNumKeypoints; ++k) {
    const int part = k % (kNumKeypoints / 2);
    const std::string name = fmt::format("{:2} {} {}", k, k == part ? "left" : "right",
                                         keypoint_part_names()[static_cast<std::size_t>(part)]);
    out.by_keypoint.push_back(
        group_of(name, judged, [k](const Judged& j) { return j.keypoint == k; }));
    const double one = out.apk[static_cast<std::size_t>(k)] = average_precision(judged, k);
    if (!std::isfinite(one)) continue;
    apk += one;
    keypoints += 1.0;
  }
  out.mean_apk = keypoints > 0.0 ? apk / keypoints : kNaN;
  out.by_height = groups_by_height(crops, judged);
  out.by_heading = groups_by_heading(crops, judged);
  double right = 0.0;
  std::array<double, 10> count = {}, visible = {};
  for (const Judged& j : judged) {
    right += (j.probability > 0.5) == j.visible ? 1.0 : 0.0;
    const double bin = std::clamp(std::floor(10.0 * j.probability), 0.0, 9.0);
    count[static_cast<std::size_t>(bin)] += 1.0;
    visible[static_cast<std::size_t>(bin)] += j.visible ? 1.0 : 0.0;
  }
  out.visibility_right = judged.empty() ? kNaN : right / static_cast<double>(judged.size());
  for (std::size_t b = 0; b < count.size(); ++b) {
    out.visible_by_probability[b] = count[b] > 0.0 ? visible[b] / count[b] : kNaN;
  }
  return out;
}

std::string keypoint_table(const KeypointEvaluation& e) {
  std::string out = fmt::format(
      "{} crops; PCK in %: at 2 px of 64 (visible, hidden, all) and at 0.1 of the box's larger "
      "side (visible, all);\nerrors of visible keypoints in px of 64: median, median offset to the "
      "right and down; inside 2 sigma in %\n",
      e.crops);
  out += fmt::format("{:<28} {:>8} {:>7} {:>7} {:>7} {:>7} {:>7} {:>6} {:>6} {:>6} {:>6}\n", "",
                     "points", "2 vis", "2 hid", "2 all", "0.1 vis", "0.1 all", "med", "du", "dv",
                     "2 sig");
  out += row(e.overall);
  for (const auto* groups : {&e.by_height, &e.by_heading, &e.by_keypoint}) {
    out += "\n";
    for (const KeypointGroup& group : *groups) {
      if (group.all.count > 0) out += row(group);
    }
  }
  const auto sigmas = [](const KeypointErrors& of) {
    return fmt::format("{} {} {}", percent(of.inside_sigmas[0]), percent(of.inside_sigmas[1]),
                       percent(of.inside_sigmas[2]));
  };
  out += fmt::format(
      "\ncoordinates inside 1, 2, 3 sigma: visible {} %, hidden {} % (normal: 68.3 95.4 99.7)\n"
      "mean APK at 0.1: {} %; visible or not is right for {} %\n",
      sigmas(e.overall.visible), sigmas(e.overall.hidden), percent(e.mean_apk),
      percent(e.visibility_right));
  return out;
}

}  // namespace camber
