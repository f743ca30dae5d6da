#include "camber/pipeline/kitti_boxes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "camber/core/errors.h"
#include "camber/evaluate/tables.h"
#include "support/test_data.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;
const KittiCalibration::Camera kCamera{721.5377, 721.5377, 609.5593, 172.854, {0.06, 0.0, 0.003}};

KittiLabel label_at(const Eigen::Vector3d& bottom_in_camera, double rotation_y) {
  KittiLabel out;
  out.frame = 3;
  out.track = 1;
  out.truncated = 0;
  out.occluded = 0;
  out.box = {500, 150, 600, 220};
  out.height = 1.5;
  out.width = 1.7;
  out.length = 4.2;
  out.location = bottom_in_camera - kCamera.offset;
  out.rotation_y = rotation_y;
  return out;
}

TEST(BoxTilt, RotationsGoThereAndBack) {
  for (const double ry : {-3.0, -1.2, 0.0, 0.4, 2.9}) {
    for (const double pitch : {-0.3, 0.0, 0.2}) {
      for (const double roll : {-0.2, 0.0, 0.1}) {
        const Eigen::Matrix3d r = rotation_of(ry, {pitch, roll});
        EXPECT_NEAR((r.transpose() * r - Eigen::Matrix3d::Identity()).norm(), 0.0, 1e-12);
        EXPECT_NEAR(r.determinant(), 1.0, 1e-12);
        EXPECT_NEAR(rotation_y(r), ry, 1e-12);
        EXPECT_NEAR(tilt_of(r).pitch, pitch, 1e-12);
        EXPECT_NEAR(tilt_of(r).roll, roll, 1e-12);
      }
    }
  }
  // Up a slope: the front is above the horizontal plane; y is down.
  EXPECT_LT(rotation_of(0.3, {0.1, 0.0})(1, 0), 0.0);
  // Right side down.
  EXPECT_GT(rotation_of(0.3, {0.0, 0.1})(1, 2), 0.0);
}

TEST(Tilts, AreWrittenAndReadByRow) {
  test::TemporaryFolder folder;
  LiftedBox a, b;
  a.tilt = {0.125, -0.0625};
  b.tilt = {-0.5, 0.25};
  b.reason = "one, two";
  write_tilts({a, b}, folder.path() / "x.tilt.csv");
  const std::vector<BoxTilt> back = read_tilts(folder.path() / "x.tilt.csv", 2);
  EXPECT_EQ(back[0].pitch, 0.125);
  EXPECT_EQ(back[1].roll, 0.25);
  EXPECT_EQ(tilt_file("a/b.txt"), "a/b.tilt.csv");
  EXPECT_THROW(read_tilts(folder.path() / "x.tilt.csv", 1), InputError);
  EXPECT_THROW(read_tilts(folder.path() / "none.tilt.csv", 1), InputError);
  std::ofstream(folder.path() / "bad.tilt.csv") << "row,frame,track,pitch,roll\n0,1,2,x,0\n";
  try {
    read_tilts(folder.path() / "bad.tilt.csv", 1);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("line 2: found \"x\", expected a number"));
  }
}

// A table computed by hand: three counted vehicles with errors of 0.3, 0.6 and 2.0 m at 10, 25 and
// 40 m; a fourth is largely occluded and does not count.
TEST(KittiTables, AreThoseComputedByHand) {
  KittiLabelFile truth, estimate;
  truth.form = estimate.form = KittiLabelForm::kTracking;
  const double depths[] = {10.0, 25.0, 40.0, 20.0};
  const Eigen::Vector3d errors[] = {{0.3, 0, 0}, {0, 0, -0.6}, {0, 1.2, 1.6}, {5, 0, 0}};
  for (int i = 0; i < 4; ++i) {
    KittiLabel label = label_at({0.0, 0.0, depths[i]}, 0.2);
    label.location.y() = 0.0;
    label.location.x() = -kCamera.offset.x();
    label.location.z() = depths[i] - kCamera.offset.z();
    label.track = i;
    label.box = {100.0 + 200 * i, 150, 200.0 + 200 * i, 200};
    label.occluded = i == 3 ? 2 : i;  // 0, 1 and 2: the third is judged below
    if (i == 2) label.occluded = 0;
    truth.labels.push_back(label);
    label.location += errors[i];
    label.rotation_y += i == 1 ? 0.1 : 0.0;
    estimate.labels.push_back(label);
  }
  const Scene scene = truth_from_kitti(truth, kCamera, 1242, 375, 0, "hand");
  const VehicleDocument document = vehicles_from_kitti(estimate, kCamera, 0, {}, "detector");
  const SceneMetrics metrics = evaluate_vehicles(scene, document);
  EXPECT_EQ(metrics.counted, 3);
  EXPECT_EQ(metrics.missed, 0);
  const auto tables = make_tables({{"hand", "detector", "", metrics}});
  const auto row = [&](const std::string& name) -> const LocalisationRow& {
    for (const LocalisationRow& r : tables.front().rows) {
      if (r.name == name) return r;
    }
    throw std::runtime_error(name);
  };
  EXPECT_NEAR(row("all").center.mean, 2.9 / 3.0, 1e-9);
  EXPECT_NEAR(row("all").center.median, 0.6, 1e-9);
  // sqrt(((0.3 - 0.9667)^2 + (0.6 - 0.9667)^2 + (2 - 0.9667)^2) / 2)
  EXPECT_NEAR(row("all").center.deviation, 0.907377, 1e-6);
  EXPECT_NEAR(row("<= 15 m").center.mean, 0.3, 1e-9);
  EXPECT_NEAR(row("> 15 m").center.mean, 1.3, 1e-9);
  EXPECT_NEAR(row("<= 30 m").center.mean, 0.45, 1e-9);
  EXPECT_NEAR(row("> 30 m").center.mean, 2.0, 1e-9);
  EXPECT_NEAR(row("all").yaw.mean, 0.1 / 3.0, 1e-9);
  EXPECT_NEAR(row("all").height.median, 0.0, 1e-9);
  EXPECT_NEAR(row("> 30 m").height.mean, 1.2, 1e-9);
  EXPECT_EQ(tables.front().recall, 1.0);
}

// Sequence 0003 as it is published: every label on itself is right, moved ones by as much as moved.
TEST(KittiTables, RealLabelsAsTruth) {
  CAMBER_REQUIRE_DATA("kitti-tracking-labels");
  const auto folder = test::data_dir() / "kitti-tracking-labels";
  const KittiCalibration::Camera camera =
      read_kitti_calibration({folder / "calib" / "0003.txt"}).camera(2);
  const KittiLabelFile labels = read_kitti_labels(folder / "label_02" / "0003.txt");
  KittiLabelFile moved = labels;
  for (KittiLabel& label : moved.labels) {
    if (label.has_box3()) label.location *= 1.02;
  }
  const Scene scene = truth_from_kitti(labels, camera, 1242, 375, 0, "0003");
  const auto measure = [&](const KittiLabelFile& file) {
    const SceneMetrics metrics =
        evaluate_vehicles(scene, vehicles_from_kitti(file, camera, 0, {}, "x"));
    return make_tables({{"0003", "x", "", metrics}}).front();
  };
  const MethodTables same = measure(labels);
  EXPECT_GT(same.counted, 100);
  EXPECT_EQ(same.recall, 1.0);
  EXPECT_NEAR(same.rows.front().center.mean, 0.0, 1e-9);
  double sum = 0.0;
  int count = 0;
  for (const TruthFrame& f : scene.truth->frames) {
    for (const TruthVehicle& v : f.vehicles) {
      if (!is_counted(v, scene.camera)) continue;
      sum += 0.02 * (v.pose.bottom_center() - camera.offset).norm();
      ++count;
    }
  }
  const MethodTables shifted = measure(moved);
  EXPECT_EQ(shifted.rows.front().center.count, count);
  EXPECT_NEAR(shifted.rows.front().center.mean, sum / count, 1e-6);
}

TEST(KittiRows, OfVehiclesGoThereAndBack) {
  Scene scene;
  SceneFrame seen;
  seen.id = 8;
  VehicleDetection detection;
  detection.id = 2;
  detection.track = 11;
  detection.score = 0.75;
  VehicleDetection untracked;
  untracked.id = 4;
  seen.vehicles = {detection, untracked};
  scene.frames = {seen};
  VehicleDocument document;
  VehicleEstimate v;
  v.id = 2;
  v.vehicle_class = "van";
  v.box = {10, 20, 60, 50};
  v.status = Status::kWeak;
  v.plane_source = "patch 5";
  v.pose.camera_from_vehicle =
      SE3(rotation_of(0.7, {0.15, -0.05}), Eigen::Vector3d(3.0, 1.2, 22.0));
  v.pose.dimensions = {5.1, 1.9, 2.2};
  VehicleEstimate none = v;
  none.id = 3;
  none.status = Status::kFailed;
  VehicleEstimate joined = v;  // by its estimate alone, over frames
  joined.id = 4;
  joined.track = 6;
  document.frames = {{8, {v, none, joined}}};
  const std::vector<LiftedBox> rows = kitti_from_vehicles(document, scene, kCamera.offset);
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[1].label.track, 6);
  EXPECT_EQ(rows[0].label.type, "Van");
  EXPECT_EQ(rows[0].label.track, 11);
  EXPECT_EQ(rows[0].label.score, 0.75);
  EXPECT_EQ(rows[0].patch, 5);
  EXPECT_NEAR(rows[0].tilt.pitch, 0.15, 1e-9);
  EXPECT_NEAR(rows[0].tilt.roll, -0.05, 1e-9);
  const VehicleDocument back = vehicles_from_kitti({KittiLabelForm::kTracking, {rows[0].label}},
                                                   kCamera, 0, {rows[0].tilt}, "read");
  ASSERT_EQ(back.frames.size(), 1u);
  EXPECT_EQ(back.frames[0].id, 8);
  const OrientedBox& pose = back.frames[0].vehicles[0].pose;
  EXPECT_LT((pose.center() - v.pose.center()).norm(), 1e-9);
  EXPECT_LT(
      (pose.camera_from_vehicle.rotation_matrix() - v.pose.camera_from_vehicle.rotation_matrix())
          .norm(),
      1e-9);
}

}  // namespace
}  // namespace camber
