#include "camber/render/detail/point_colors.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "camber/cloud/las_names.h"
#include "camber/cloud/normals.h"
#include "camber/core/errors.h"
#include "camber/evaluate/compare.h"

namespace camber::detail {
namespace {

std::vector<std::string> height_title(const PictureSpace& space) {
  if (space.height_name == "height above the road at the camera") {
    return {"height above the", "road at the camera", "(" + space.unit + ")"};
  }
  if (space.height_name == "height above the camera") {
    return {"height above", "the camera (" + space.unit + ")"};
  }
  if (space.height_name.size() < 10) return {space.height_name + " (" + space.unit + ")"};
  return {space.height_name, "(" + space.unit + ")"};
}

/// Signed distances to the dense truth, along the normal of its nearest point, up is positive, one
/// a point kept; NaN where the truth has no normal.
std::vector<float> truth_errors(const PictureContent& content, const Eigen::Vector3d& up,
                                const std::vector<std::uint32_t>& kept) {
  const SE3 truth_from_reference = content.reference_from_truth_cloud.inverse();
  std::vector<Eigen::Vector3d> places;
  places.reserve(kept.size());
  for (const std::uint32_t i : kept) {
    places.push_back(truth_from_reference *
                     (content.cloud->origin + content.cloud->points[i].cast<double>()));
  }
  Shape truth;
  truth.cloud.origin = content.truth_cloud->origin;
  truth.cloud.points = content.truth_cloud->points;
  NormalOptions normals;
  normals.up = truth_from_reference.rotation() * up;
  estimate_normals(truth.cloud, normals);
  const ShapeDistances found = distances_to(truth, places, 0);
  return {found.along_normal.begin(), found.along_normal.end()};
}

[[noreturn]] void lacking(const std::string& what) {
  throw NoAnswerError("the points cannot be coloured: the cloud has no " + what);
}

/// What maps use for the classes of ASPRS LAS 1.4 R15, table 17, red left to the truth.
Color class_color(int number) {
  switch (number) {
    case 0:
    case 1:
      return {150, 150, 150, 1.0};
    case 2:
      return {166, 118, 70, 1.0};
    case 3:
      return {178, 206, 96, 1.0};
    case 4:
      return {96, 176, 78, 1.0};
    case 5:
      return {26, 120, 60, 1.0};
    case 6:
      return {236, 140, 30, 1.0};
    case 9:
      return {40, 120, 210, 1.0};
    case 10:
      return {90, 60, 140, 1.0};
    case 11:
      return {84, 88, 96, 1.0};
    case 17:
      return {20, 170, 190, 1.0};
    case 7:
    case 18:
      return {230, 70, 180, 1.0};
    default:
      return categorical(number);
  }
}

/// Colours by classes that have names: of ASPRS, or ground and not. @return whether these are some
bool color_classes(const std::string& name, const std::vector<int>& labels, PictureSpace* space) {
  const bool ground = name == "ground";
  if (!ground && name != "classification") return false;
  std::map<int, std::size_t> counts;
  for (const std::uint32_t i : space->kept) ++counts[labels[i]];
  if (ground && (counts.begin()->first < 0 || counts.rbegin()->first > 1)) return false;
  const auto ink_of = [&](int number) {
    return class_color(!ground ? number : number == 1 ? 2 : 1);
  };
  for (const std::uint32_t i : space->kept) {
    const Color ink = ink_of(labels[i]);
    space->colors.push_back({ink.red, ink.green, ink.blue});
  }
  constexpr std::size_t kMost = 24;  // in a legend
  for (const auto& [number, count] : counts) {
    if (space->classes.size() == kMost) break;
    space->classes.emplace_back(ink_of(number), ground ? (number == 1 ? "ground" : "not ground")
                                                       : std::string(las_class_name(number)) +
                                                             " (" + std::to_string(number) + ")");
  }
  return true;
}

/// The values that the points of a picture are coloured by; none where they have colours already.
std::vector<float> color_values(const PictureContent& content, const Eigen::Vector3d& up,
                                const PointColor& color, PictureSpace* space) {
  const RoadCloud& cloud = *content.cloud;
  const std::vector<std::uint32_t>& kept = space->kept;
  std::vector<float> values;
  values.reserve(kept.size());
  switch (color.by) {
    case PointColor::By::kImage:
      if (cloud.colors.empty()) lacking("colours");
      for (const std::uint32_t i : kept) space->colors.push_back(cloud.colors[i]);
      return {};
    case PointColor::By::kPatch: {
      const auto found = cloud.labels.find("patch");
      if (found == cloud.labels.end()) lacking("label \"patch\"");
      for (const std::uint32_t i : kept) {
        const int patch = found->second[i];
        const Color ink = patch < 0 ? Color{170, 170, 170, 1.0} : categorical(patch);
        space->colors.push_back({ink.red, ink.green, ink.blue});
      }
      return {};
    }
    case PointColor::By::kHeight:
      for (const Eigen::Vector3f& p : space->points) values.push_back(p.z());
      space->color_range = space->heights;
      space->color_title = height_title(*space);
      break;
    case PointColor::By::kSigma:
      if (cloud.sigmas.empty()) lacking("standard deviations");
      for (const std::uint32_t i : kept) values.push_back(cloud.sigmas[i]);
      space->color_title = {"standard", "deviation (" + space->unit + ")"};
      break;
    case PointColor::By::kError:
      if (content.truth_cloud) {
        values = truth_errors(content, up, kept);
        space->color_title = {"above (+) or", "below the", "truth (" + space->unit + ")"};
        space->color_scale = diverging;
        break;
      }
      if (cloud.scalars.find("error") == cloud.scalars.end()) {
        lacking("attribute \"error\", and there is no dense truth to measure against");
      }
      [[fallthrough]];
    case PointColor::By::kScalar: {
      const std::string name = color.by == PointColor::By::kError ? "error" : color.name;
      const auto scalar = cloud.scalars.find(name);
      const auto label = cloud.labels.find(name);
      if (scalar == cloud.scalars.end() && label == cloud.labels.end()) {
        lacking("attribute \"" + name + "\"");
      }
      if (scalar == cloud.scalars.end() && color_classes(name, label->second, space)) return {};
      for (const std::uint32_t i : kept) {
        values.push_back(scalar != cloud.scalars.end() ? scalar->second[i]
                                                       : static_cast<float>(label->second[i]));
      }
      space->color_title = {name};
      break;
    }
  }
  return values;
}

/// The range of the colour bar: without stray values, symmetric for diverging colours.
void choose_range(const PointColor& color, const std::vector<float>& values, PictureSpace* space) {
  if (color.by != PointColor::By::kHeight) {
    std::vector<float> finite;
    for (const float value : values) {
      if (std::isfinite(value)) finite.push_back(value);
    }
    if (finite.empty()) lacking("finite value of what the colours should mean");
    space->color_range = robust_range(finite, 0.02, 0.98);
    if (!(space->color_range.span() > 0.0)) {
      const double half = std::max(1e-6, 1e-3 * std::abs(space->color_range.low));
      space->color_range = {space->color_range.low - half, space->color_range.high + half};
    }
  }
  if (space->color_scale == diverging) {
    const double reach =
        std::max(std::abs(space->color_range.low), std::abs(space->color_range.high));
    space->color_range = {-reach, reach};
  }
}

}  // namespace

void color_points(const PictureContent& content, const Eigen::Vector3d& up, const PointColor& color,
                  PictureSpace* space) {
  const std::vector<float> values = color_values(content, up, color, space);
  if (!space->colors.empty()) return;
  choose_range(color, values, space);
  space->has_color_bar = true;
  for (const float value : values) {
    const Color ink =
        space->color_scale((value - space->color_range.low) / space->color_range.span());
    space->colors.push_back({ink.red, ink.green, ink.blue});
  }
}

}  // namespace camber::detail
