// samples/own_drive, the README's example of a person's own data: what its script makes, and the
// README's commands on it against the world that it was drawn from.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>

#include "camber/geometry/lens_map.h"
#include "camber/image/image_io.h"
#include "camber/image/video.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"
#include "camber/synth/synthesise.h"
#include "cli/run_program.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::run_camber;

/// As in samples/own_drive/make.py.
SynthOptions drive_options() {
  SynthOptions options;
  options.profile = RoadProfileKind::kSteepHill;
  options.seed = 21;
  options.num_frames = 20;
  options.speed = 8.0;
  options.camera_height = 1.4;
  options.camera = {960, 540, 560.0, 560.0, 478.5, 250.0};
  options.lens = LensModel::kBrown;
  options.lens_coefficients = {-0.3, 0.1, 0.0004, -0.0003, -0.012};
  options.num_threads = 2;
  return options;
}

fs::path drive_folder() { return test::source_dir() / "samples/own_drive"; }

/// The commands of the README's section, as their words.
std::vector<std::vector<std::string>> readme_commands() {
  std::string text = test::read_text(test::source_dir() / "README.md");
  text = text.substr(text.find("## Your own data"));
  const auto begin = text.find("```sh\n") + 6;
  text = text.substr(begin, text.find("```\n", begin) - begin);
  text = std::regex_replace(text, std::regex("\\\\\n"), " ");
  std::vector<std::vector<std::string>> out;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line.substr(0, line.find('#')));
    std::vector<std::string> command;
    for (std::string word; words >> word;) command.push_back(word);
    if (!command.empty()) out.push_back(command);
  }
  return out;
}

TEST(OwnDrive, IsSmallAndWhatItsScriptMakes) {
  std::uintmax_t size = 0;
  for (const auto& entry : fs::directory_iterator(drive_folder())) size += entry.file_size();
  EXPECT_LT(size, 3000000u);
  const SynthOptions options = drive_options();
  const SynthWorld world = make_synth_world(world_options(options));
  const ViewCamera view = view_camera(options);
  // The script hands over the same numbers.
  const std::string script = test::read_text(drive_folder() / "make.py");
  for (const char* part :
       {"\"--seed\", \"21\"", "\"--speed\", \"8\"", "\"--camera-height\", \"1.4\"",
        "FRAMES, RATE = 20, 10", "LENS = [-0.3, 0.1, 0.0004, -0.0003, -0.012]",
        "FOCAL, MIDDLE, SIZE = 560.0, (478.5, 250.0), (960, 540)"}) {
    EXPECT_THAT(script, ::testing::HasSubstr(part));
  }

  const auto video = open_video(drive_folder() / "drive.mp4");
  const LensMap lens(view.camera(), {options.lens, options.lens_coefficients, options.camera});
  const json boxes = json::parse(test::read_text(drive_folder() / "boxes.json"));
  CameraSensor sensor = options.sensor;
  sensor.seed = options.seed;
  int frames = 0;
  for (; video->next(); ++frames) {
    if (frames != 0 && frames != 13) continue;
    if (frames == 13) {
      const Image seen = video->image();
      const auto drawn = render_view(world, frames, view, sensor, 2);
      ASSERT_EQ(seen.data.size(), drawn.size());
      double sum = 0.0;
      for (std::size_t i = 0; i < drawn.size(); ++i) sum += std::abs(seen.data[i] - drawn[i]);
      // Compression: colours at half the size, and noise of 1.2 levels lost.
      EXPECT_LT(sum / static_cast<double>(drawn.size()), 3.0);
    }

    DetectorModel detector;
    detector.seed = options.seed;
    const ViewTruth traced = trace_view(world, frames, view.camera(), 2);
    const auto detections = simulate_detections(
        world, frames, view, true_vehicles(world, frames, view, traced), detector);
    std::vector<Box2> found;
    for (const json& box : boxes["annotations"]) {
      if (box["image_id"] != frames) continue;
      const auto b = box["bbox"].get<std::vector<double>>();
      found.push_back({b[0], b[1], b[0] + b[2], b[1] + b[3]});
    }
    ASSERT_EQ(found.size(), detections.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
      const Box2& box = found[i];
      if (box.x1 < 1.0 || box.y1 < 1.0 || box.x2 > 958.0 || box.y2 > 538.0) continue;  // cut off
      const auto centre = lens.raw_from_pinhole(detections[i].box.center());
      ASSERT_TRUE(centre.has_value());
      EXPECT_LT((found[i].center() - *centre).norm(), 0.06 * detections[i].box.width() + 0.5);
    }
  }
  EXPECT_EQ(frames, 20);
}

/// Errors of the road's height at true points 4 to 20 m ahead of the reference camera, against the
/// world.
std::vector<double> road_height_errors(const SynthWorld& world, const RoadSurface& surface,
                                       int reference) {
  const SE3 camera_from_world = world.views[reference].world_from_camera.inverse();
  const Eigen::Vector3d eye = world.views[reference].world_from_camera.translation();
  std::vector<double> out;
  for (double station = 0.0; station < 60.0; station += 0.5) {
    for (const double offset : {-1.5, 0.0, 1.5}) {
      if (world.road.kind(station, offset) != GroundKind::kRoad) continue;
      const Eigen::Vector3d point = world.road.point(station, offset);
      const Eigen::Vector3d place = camera_from_world * point;
      if (place.z() < 4.0 || (point - eye).norm() > 20.0) continue;
      const SurfaceQuery query = surface.query(place);
      if (query.status == Status::kFailed) continue;
      out.push_back(std::abs(query.plane.plane.signed_distance(place)));
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

TEST(OwnDrive, TheReadmesCommandsGiveTheRoadInMetres) {
  const test::TemporaryFolder folder;
  const auto commands = readme_commands();
  ASSERT_EQ(commands.size(), 2u);
  EXPECT_EQ(commands[0][1] + " " + commands[0][2], "import video");
  EXPECT_EQ(commands[1][1], "reconstruct");
  std::string output;
  for (std::vector<std::string> words : commands) {
    ASSERT_EQ(words[0], "camber");
    words.erase(words.begin());
    for (std::string& word : words) {
      if (word.rfind("samples/", 0) == 0) word = (test::source_dir() / word).string();
      if (word.rfind("out/", 0) == 0) word = (folder.path() / word).string();
    }
    const auto result = run_camber(words);
    ASSERT_EQ(result.exit_code, 0) << words[0] << ": " << result.error;
    output += result.out + result.error;
  }
  EXPECT_THAT(output, ::testing::HasSubstr("brown distortion"));
  EXPECT_THAT(output, ::testing::HasSubstr("85 boxes from boxes.json"));
  const fs::path result = folder.path() / "out/drive";
  EXPECT_GT(test::read_text(result / "report.html").size(), 100000u);

  const SynthWorld world = make_synth_world(world_options(drive_options()));
  const RoadSurface surface = read_surface(result / "surface.json");
  const RunDocument run = read_run(result / "run.json");
  EXPECT_TRUE(surface.metric);
  ASSERT_GE(run.cameras.size(), 3u);
  int reference = -1;
  for (const auto& camera : run.cameras) {
    if (camera.reference_from_camera.translation().norm() < 1e-9) reference = camera.id;
  }
  ASSERT_GE(reference, 0);
  for (const auto& camera : run.cameras) {
    if (camera.id == reference) continue;
    const double driven = (world.views[camera.id].world_from_camera.translation() -
                           world.views[reference].world_from_camera.translation())
                              .norm();
    const double found = camera.reference_from_camera.translation().norm();
    EXPECT_NEAR(found / driven, 1.0, 3.0 * surface.scale_sigma);
    EXPECT_NEAR(found / driven, 1.0, 0.03);
  }
  const std::vector<double> heights = road_height_errors(world, surface, reference);
  ASSERT_GT(heights.size(), 80u);
  EXPECT_LT(heights[heights.size() / 2], 0.03);       // m; half of them
  EXPECT_LT(heights[heights.size() * 9 / 10], 0.06);  // m; nine of ten: 4 % of the height
  const VehicleDocument vehicles = read_vehicles(result / "vehicles.json");
  EXPECT_THAT(vehicles.detections_source, ::testing::HasSubstr("keypoints shipped"));
  int placed = 0;  // by boxes and the keypoints that the network finds in them
  for (const auto& frame : vehicles.frames) {
    for (const VehicleEstimate& vehicle : frame.vehicles) placed += vehicle.status == Status::kOk;
  }
  EXPECT_GE(placed, 5);
}

}  // namespace
}  // namespace camber
