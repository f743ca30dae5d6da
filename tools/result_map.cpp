#include "result_map.h"

#include <cmath>

#include "camber/core/protected_inputs.h"
#include "camber/scene/results.h"
#include "crs.h"

namespace fs = std::filesystem;

namespace camber::tools {

std::optional<GeoReference> georeference_beside(const fs::path& file) {
  const fs::path run = file.parent_path() / "run.json";
  std::error_code ignored;
  if (!fs::exists(run, ignored)) return std::nullopt;
  protect_inputs({run});
  return georeference_of(read_run(run), run);
}

void take_to_map(const GeoReference& map, RoadCloud* cloud) {
  const Eigen::Matrix3d turn = map.map_from_reference.rotation_matrix();
  const Eigen::Vector3d start = map.map_from_reference * cloud->origin;
  for (int k = 0; k < 3; ++k) cloud->origin[k] = std::round(start[k]);
  const Eigen::Vector3d rest = start - cloud->origin;
  for (Eigen::Vector3f& p : cloud->points) p = (turn * p.cast<double>() + rest).cast<float>();
  for (Eigen::Vector3f& n : cloud->normals) n = (turn * n.cast<double>()).cast<float>();
  for (std::array<float, 6>& c : cloud->covariances) {
    Eigen::Matrix3d full;
    full << c[0], c[1], c[2], c[1], c[3], c[4], c[2], c[4], c[5];
    full = turn * full * turn.transpose();
    c = {static_cast<float>(full(0, 0)), static_cast<float>(full(0, 1)),
         static_cast<float>(full(0, 2)), static_cast<float>(full(1, 1)),
         static_cast<float>(full(1, 2)), static_cast<float>(full(2, 2))};
  }
  cloud->frame = CloudFrame::kZUp;
}

std::vector<GeoPoint> track_on_earth(const std::vector<StampedPose>& poses, const std::string& crs,
                                     bool seconds) {
  constexpr double kDated = 1e8;  // s, 1973
  std::vector<Eigen::Vector2d> places;
  for (const StampedPose& pose : poses) {
    places.push_back(pose.world_from_camera.translation().head<2>());
  }
  std::vector<GeoPoint> out = places_on_earth(crs, places);
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i].altitude = poses[i].world_from_camera.translation().z();
    if (seconds && poses[i].time_s > kDated) out[i].time_s = poses[i].time_s;
  }
  return out;
}

}  // namespace camber::tools
