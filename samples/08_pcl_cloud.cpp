// From a pcl::PointCloud to a road surface, and back to a pcl::PointCloud with the patch of each
// point as its label.
//   08_pcl_cloud
#include <camber/cloud/pcl.h>
#include <camber/core/errors.h>
#include <camber/core/random.h>
#include <camber/road/fit_road_surface.h>
#include <pcl/point_types.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

int main() try {
  // A road of 6 m by 40 m with 1 cm of noise: level, then a climb of 9 %. x ahead, z up.
  const camber::CounterRandom random(1);
  pcl::PointCloud<pcl::PointXYZI> scan;
  for (unsigned i = 0; i < 20000; ++i) {
    pcl::PointXYZI point;
    point.x = static_cast<float>(random.uniform(4 * i, 0.0, 40.0));
    point.y = static_cast<float>(random.uniform(4 * i + 1, -3.0, 3.0));
    point.z = 0.09f * std::max(0.0f, point.x - 20.0f) +
              static_cast<float>(0.01 * random.normal(4 * i + 2));
    point.intensity = 0.5f;
    scan.push_back(point);
  }

  camber::RoadCloud cloud = camber::from_pcl(scan);  // intensity is kept in cloud.scalars
  const camber::RoadSurfaceFit fit = camber::fit_road_surface(cloud, {});
  if (fit.status == camber::Status::kFailed) throw camber::NoAnswerError(fit.reason);
  for (const camber::PlanePatch& patch : fit.surface.patches) {
    std::printf("patch %d: grade %+.1f degrees\n", patch.id, patch.grade * 180.0 / M_PI);
  }

  // PCL's labels have no sign: 0 is none, patch ids begin at 1.
  std::vector<int>& label = cloud.labels["label"];
  for (const int patch : fit.labels) label.push_back(patch + 1);
  const auto labelled = camber::to_pcl<pcl::PointXYZL>(cloud);
  const auto climbing = std::count_if(labelled.begin(), labelled.end(),
                                      [](const pcl::PointXYZL& p) { return p.label == 2; });
  std::printf("%ld points of the label 2\n", static_cast<long>(climbing));
} catch (const camber::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return error.exit_code();
}
