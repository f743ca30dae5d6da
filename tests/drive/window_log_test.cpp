#include "camber/drive/window_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "support/test_data.h"

namespace camber {
namespace {

WindowMeasurement made_window(int reference) {
  WindowMeasurement w;
  w.reference = reference;
  w.frames = {reference - 1, reference, reference + 1};
  w.frame_from_reference = {SE3(rotation_from_vector({0.1, 0.2, 0.3}), {0.1, 0.2, -1.0 / 3.0}),
                            SE3(), SE3(Eigen::Quaterniond::Identity(), {0, 0, 1})};
  w.covariance = Eigen::MatrixXd::Random(12, 12);
  w.log_scale = 1.0 / 7.0;
  w.scale_sigma = 0.1;
  w.reason = "none";
  w.ego.emplace();
  w.ego->covariance = Eigen::Matrix3d::Random();
  w.road = {{{1.0F, 2.0F, 1.0F / 3.0F}, 0.25F, 2, {1, 2, 250}}};
  VehicleEstimate v;
  v.id = 3;
  v.vehicle_class = "van";
  v.status = Status::kWeak;
  v.pose.camera_from_vehicle = SE3(rotation_from_vector({0, 0.5, 0}), {1, 2, 30});
  w.vehicles.resize(2);
  w.vehicles[0].id = reference;
  w.vehicles[0].vehicles = {v};
  w.vehicles[1].id = reference + 1;
  w.vehicles[1].vehicles = {v, v};
  w.tracked = {{reference, 3, 5}};
  return w;
}

std::vector<int> references_in(const WindowLog& log) {
  std::vector<int> out;
  log.for_each_window([&](const WindowMeasurement& w) { out.push_back(w.reference); });
  return out;
}

TEST(WindowLog, KeepsWindowsExactly) {
  const WindowMeasurement w = made_window(5);
  const std::vector<std::uint8_t> bytes = encode(w);
  const WindowMeasurement back = decode_window(bytes);
  EXPECT_EQ(encode(back), bytes);
  EXPECT_EQ(back.frames, w.frames);
  EXPECT_EQ(back.covariance, w.covariance);
  EXPECT_EQ(back.frame_from_reference[0].translation(), w.frame_from_reference[0].translation());
  EXPECT_EQ(back.road[0].point, w.road[0].point);
  EXPECT_EQ(back.road[0].color, w.road[0].color);
  ASSERT_EQ(back.vehicles.size(), 2U);
  EXPECT_EQ(back.vehicles[0].vehicles[0].vehicle_class, "van");
  EXPECT_TRUE(std::isnan(back.vehicles[0].vehicles[0].keypoints[0].x()));
  EXPECT_EQ(back.vehicles[1].id, 6);
  EXPECT_EQ(back.vehicles[1].vehicles.size(), 2U);
  EXPECT_EQ(back.tracked[0].track, 5);
}

TEST(WindowLog, RefusesBytesOfNothing) {
  EXPECT_THROW(decode_window({1, 2, 3}), std::invalid_argument);
}

TEST(WindowLog, GoesOnAfterARecordThatIsNotWhole) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "windows.log";
  const nlohmann::json header = {{"frames", {1, 2, 3}}};
  {
    WindowLog log(path, header, false);
    log.append(FrameRecord{1, FrameRecord::Kind::kKey, "", true});
    log.append(made_window(2));
    log.append(FrameRecord{2, FrameRecord::Kind::kUnreadable, "damaged"});
    log.append(made_window(3));
    log.flush();
  }
  const auto whole = std::filesystem::file_size(path);
  // Whatever of the last record is there, the one before is kept and the file can be gone on with.
  for (const std::uintmax_t cut : {whole - 1, whole - 40, whole - encode(made_window(3)).size()}) {
    std::filesystem::resize_file(path, cut);
    WindowLog log(path, header, true);
    EXPECT_EQ(references_in(log), std::vector<int>{2}) << cut;
    ASSERT_EQ(log.frames().size(), 2U);
    EXPECT_EQ(log.frames()[1].reason, "damaged");
    EXPECT_TRUE(log.frames()[0].still);
    EXPECT_FALSE(log.frames()[1].still);
    EXPECT_TRUE(log.has_window(2));
    EXPECT_FALSE(log.has_window(3));
    log.append(made_window(3));
    log.flush();
    EXPECT_EQ(std::filesystem::file_size(path), whole);
  }
}

TEST(WindowLog, NamesWhatDiffersFromThePartThatIsThere) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "windows.log";
  { const WindowLog log(path, {{"seed", 1}}, false); }
  try {
    const WindowLog log(path, {{"seed", 2}}, true);
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("another seed (1, now 2)"));
  }
  EXPECT_NO_THROW(WindowLog(path, {{"seed", 2}}, false));
}

TEST(WindowLog, RefusesAForeignFile) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "windows.log";
  std::ofstream(path) << "something else entirely, and long enough";
  EXPECT_THROW(WindowLog(path, {}, true), InputError);
}

}  // namespace
}  // namespace camber
