#include "ground_points.h"

#include <fmt/format.h>

#include <algorithm>

namespace camber::tools {

std::optional<std::vector<int>> points_to_judge(const RoadCloud& cloud,
                                                const std::vector<int>& keep_classes) {
  constexpr int kWithheld = 4;  // of class_flags, in all point formats
  const auto classes = cloud.labels.find("classification");
  const auto flags = cloud.labels.find("class_flags");
  const bool with_classes = classes != cloud.labels.end(), with_flags = flags != cloud.labels.end();
  if (!with_classes && !with_flags) return std::nullopt;
  std::vector<int> judged;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const bool kept = with_classes && std::find(keep_classes.begin(), keep_classes.end(),
                                                classes->second[i]) != keep_classes.end();
    const bool withheld = with_flags && (flags->second[i] & kWithheld) != 0;
    if (!kept && !withheld) judged.push_back(static_cast<int>(i));
  }
  if (judged.size() == cloud.size()) return std::nullopt;
  return judged;
}

double ground_margin(const GroundOptions& options) {
  GroundPlan plan;
  plan.from_air = true;
  plan.largest_object = options.largest_object > 0.0 ? options.largest_object : 30.0;
  plan.cell = options.cell > 0.0 ? options.cell : 1.0;
  return options.plan ? options.plan->reach() : plan.reach();
}

std::string remark_on_ground(const GroundSegmentation& found) {
  if (found.status == Status::kFailed || found.ground_area_share >= 0.5) return {};
  return fmt::format(
      "ground was found in {:.0f} % of the area that has points: check the unit and the up "
      "direction, and that no object is wider than --largest-object, now {:g} m",
      100.0 * found.ground_area_share, found.largest_object);
}

GroundSource ground_source_from(const std::string& name) {
  for (const GroundSource source : {GroundSource::kClasses, GroundSource::kLabels,
                                    GroundSource::kCompute, GroundSource::kAll}) {
    if (name == to_string(source)) return source;
  }
  return GroundSource::kAuto;
}

}  // namespace camber::tools
