#include "camber/pipeline/run_details.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "camber/cloud/number_text.h"
#include "camber/pipeline/estimate_vehicles.h"
#include "camber/pipeline/stages/camera_uncertainty.h"

namespace camber {
namespace {

nlohmann::json photometric_json(const ReconstructOptions& options, const PinholeCamera& camera,
                                const PhotometricGround& ground) {
  nlohmann::json out = {{"status", !options.photometric ? "not run"
                                   : ground.field       ? "accepted"
                                                        : "refused"},
                        {"reason", ground.rejection}};
  if (ground.field) {
    const DirectEvidence::Costs costs = ground.evidence.within(
        Eigen::Vector2d::Zero(), Eigen::Vector2d(camera.width, camera.height));
    out["held_out_pixels"] = costs.pixels;
    out["held_out_cost_before"] = costs.before;
    out["held_out_cost_after"] = costs.after;
  }
  return out;
}

const ConstraintReport* report_of(const ScaledRoad& scaled, const std::string& name) {
  const auto found = std::find_if(scaled.reports.begin(), scaled.reports.end(),
                                  [&](const ConstraintReport& r) { return r.name == name; });
  return found == scaled.reports.end() ? nullptr : &*found;
}

/// "used", "not used" or "not run", with the reason.
nlohmann::json source_json(const ScaledRoad& scaled, const std::string& name, bool wanted) {
  const ConstraintReport* report = report_of(scaled, name);
  const bool used = report && report->accepted;
  return {{"status", used     ? "used"
                     : wanted ? "not used"
                              : "not run"},
          {"reason", report ? report->reason : ""}};
}

nlohmann::json markings_json(const ReconstructOptions& options, const ScaledRoad& scaled) {
  nlohmann::json out = source_json(scaled, "lane_markings", options.scale.use_markings);
  if (out["status"] != "used") return out;
  const LaneMarkingConstraint& m = scaled.markings;
  out.update({{"dashes", m.dashes},
              {"crossings", m.crossings},
              {"farthest", m.farthest},
              {"misfit_before", m.misfit_before},
              {"misfit_after", m.misfit_after},
              {"scale_change", std::expm1(scaled.scale_change)}});
  return out;
}

nlohmann::json width_json(const ReconstructOptions& options, const ScaledRoad& scaled) {
  nlohmann::json out = source_json(scaled, "road_width", options.scale.use_road_width);
  if (out["status"] != "used") return out;
  const RoadWidthConstraint& w = scaled.width;
  out.update({{"places", w.places},
              {"refused", w.rejected},
              {"width", w.width},
              {"farthest", w.farthest},
              {"misfit_before", w.misfit_before},
              {"misfit_after", w.misfit_after}});
  return out;
}

/// How far the road bends before it is seen, and what that does to the scale.
nlohmann::json scale_source_json(const LoadedFrames& frames, const PhotometricGround& ground,
                                 const ScaledRoad& scaled) {
  const ConstraintReport* markings = report_of(scaled, "lane_markings");
  const bool marked = markings && markings->accepted;
  const EgoPlane& ego = ground.ground.ego;
  const std::optional<double>& height = frames.known.camera_height;
  std::string source = height ? "camera height over the ego plane" : "";
  for (const auto& [name, by] : {std::pair("known_poses", "given positions"), {"speed", "speed"}}) {
    const ConstraintReport* path = report_of(scaled, name);
    if (source.empty() && path && path->accepted) source = by;
  }
  if (marked) source += source.empty() ? "markings" : ", and markings";
  return {{"source", source.empty() ? "not given" : source},
          {"sigma_camera_height",
           height ? nlohmann::json(frames.known.camera_height_sigma / *height) : nlohmann::json()},
          {"sigma_road_shape", std::sqrt(ego.plane.covariance(2, 2)) / ego.height},
          {"bend_correction", ego.height / ego.near_plane_height - 1.0}};
}

/// What comes before and after the used ids: "0 to 3 and 9", or nothing.
std::string spans_beyond(const std::vector<int>& used, const std::vector<int>& asked) {
  const auto first = std::find(asked.begin(), asked.end(), used.front());
  const auto last = std::find(first, asked.end(), used.back()) + 1;
  std::vector<std::string> spans;
  for (const auto& [from, to] : {std::pair(asked.begin(), first), std::pair(last, asked.end())}) {
    if (from == to) continue;
    spans.push_back(to - from == 1 ? fmt::format("{}", *from)
                                   : fmt::format("{} to {}", *from, *(to - 1)));
  }
  return fmt::format("{}", fmt::join(spans, " and "));
}

}  // namespace

Reconstruction handed_out(const std::vector<int>& frame_ids, const ReconstructOptions& options,
                          LoadedFrames& frames, AssembledRoad road) {
  stages::include_camera_sigma(frames, &road);
  Reconstruction out;
  for (const SceneFrame& frame : frames.frames) out.frame_ids.push_back(frame.id);
  out.reference_frame = frames.frames[frames.reference].id;
  out.cloud = std::move(road.cloud);
  out.surface = std::move(road.surface);
  out.vehicles = std::move(road.vehicles);
  out.vehicles.preset = to_string(options.preset);
  out.vehicles.keypoint_set = static_cast<int>(options.vehicles.fit.keypoint_set);
  out.run = std::move(road.run);
  const std::string left_out = spans_beyond(out.frame_ids, frame_ids);
  if (!left_out.empty()) {
    out.run.warnings.push_back(
        {"frames_left_out",
         fmt::format("frames {} share too little with frame {}, the reference, and are left out",
                     left_out, out.reference_frame)});
  }
  if (!frames.contradicted_poses.empty()) {
    out.run.warnings.push_back(
        {"poses_contradicted",
         frames.poses_of_other_moments
             ? fmt::format("the given poses are not used, nor are the lengths between them: they "
                           "turn by other angles than the images, as poses of other moments do "
                           "(is their clock the images'?): {}",
                           frames.contradicted_poses)
             : fmt::format("of the given poses only the lengths between the positions are used: {}",
                           frames.contradicted_poses)});
  }
  for (std::string& text : unknown_classes(frames.frames, options.vehicles.fit.prior)) {
    out.run.warnings.push_back({"unknown_class", std::move(text)});
  }
  out.images = std::move(frames.color);
  return out;
}

void describe_run(const ReconstructOptions& options, const std::vector<int>& frame_ids,
                  const LoadedFrames& frames, const PhotometricGround& ground,
                  const ScaledRoad& scaled, RunDocument* document) {
  document->seed = options.seed;
  *document->options = {{"preset", to_string(options.preset)},
                        {"method", to_string(options.vehicles.method)},
                        {"frames", frame_ids},
                        {"rounds", options.rounds},
                        {"photometric", options.photometric},
                        {"use_masks", options.load.use_masks},
                        {"use_markings", options.scale.use_markings},
                        {"use_road_width", options.scale.use_road_width},
                        {"tracks", options.vehicles.tracks},
                        {"keypoint_set", static_cast<int>(options.vehicles.fit.keypoint_set)}};
  nlohmann::json& extra = *document->extra;
  extra["reference_frame"] = frames.frames[frames.reference].id;
  extra["motion"] = {{"pixel_sigma", ground.motion.pixel_sigma},
                     {"inlier_ratio", ground.motion.inlier_ratio},
                     {"known_poses", ground.motion.metres_per_baseline.has_value()}};
  extra["direct"] = photometric_json(options, frames.camera, ground);
  extra["markings"] = markings_json(options, scaled);
  extra["road_width"] = width_json(options, scaled);
  if (!ground.motion.metres_per_baseline) {
    extra["scale_from"] = scale_source_json(frames, ground, scaled);
  }
  extra["road_from"] = frames.has_masks() ? "mask" : "geometry";
}

}  // namespace camber
