#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "camber/road/road_surface.h"
#include "camber/scene/results.h"
#include "run_program.h"
#include "support/test_data.h"

namespace camber::test {

/// A climbing, banked road of two patches in a camera's frame, 40 m long, 7 m wide.
inline RoadSurface climbing_road() {
  RoadSurface surface;
  for (int i = 0; i < 2; ++i) {
    const double near = 20.0 * i, far = near + 20.0, slope = 0.05 + 0.05 * i, bank = 0.02;
    const auto place = [&](double x, double z) {
      return Eigen::Vector3d(x, 1.6 - (i == 0 ? 0.0 : 1.0) - slope * (z - near) + bank * x, z);
    };
    PlanePatch patch;
    patch.id = i;
    patch.status = Status::kOk;
    patch.inliers = 100;
    const Eigen::Vector3d a = place(0, near), b = place(0, far), c = place(1, near);
    patch.plane.plane.normal = (b - a).cross(c - a).normalized();
    if (patch.plane.plane.normal.y() > 0.0) patch.plane.plane.normal *= -1.0;
    patch.plane.plane.offset = -patch.plane.plane.normal.dot(a);
    patch.plane.centroid = place(0, near + 10.0);
    patch.plane.axis1 = (b - a).normalized();
    patch.plane.axis2 = patch.plane.plane.normal.cross(patch.plane.axis1);
    patch.plane.covariance = Eigen::Vector3d(1e-6, 1e-6, 1e-6).asDiagonal();
    patch.boundary = {place(-3.5, near), place(3.5, near), place(3.5, far), place(-3.5, far)};
    surface.patches.push_back(patch);
  }
  for (int k = 1; k <= 20; ++k) surface.driven_line.emplace_back(0.0, 1.6 - 0.05 * k, k);
  return surface;
}

class ExportProgram : public ::testing::Test {
 protected:
  void SetUp() override {
    surface_ = climbing_road();
    write_json(to_json(surface_), folder_.path() / "surface.json");
  }
  std::string file(const std::string& name) const { return (folder_.path() / name).string(); }

  TemporaryFolder folder_;
  RoadSurface surface_;
};

}  // namespace camber::test
