#include "faults/work_folder.h"

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "camber/cloud/cloud_io.h"
#include "camber/core/random.h"
#include "detect/made_onnx.h"
#include "scene/write_image.h"
#ifdef CAMBER_HAS_ROSBAG
#include "cli/bag_maker.h"
#include "support/ros_messages.h"
#endif

namespace camber::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

/// Removes every value of a key, at any depth.
void remove_key(json& value, const std::string& key) {
  if (value.is_object()) value.erase(key);
  if (!value.is_structured()) return;
  for (json& part : value) remove_key(part, key);
}

RoadCloud level_square(double height) {
  RoadCloud cloud;
  const CounterRandom random(3);
  for (std::uint64_t i = 0; i < 1200; ++i) {
    cloud.points.push_back(Eigen::Vector3d(random.uniform(4 * i, -20, 20),
                                           random.uniform(4 * i + 1, -20, 20),
                                           height + 0.02 * random.normal(i))
                               .cast<float>());
  }
  return cloud;
}

}  // namespace

std::string VerbCase::name() const {
  const std::string& verb = arguments.at(0);
  if (verb == "import" || verb == "keypoints" || verb == "prior" || verb == "tiles")
    return verb + " " + arguments.at(1);
  for (std::size_t i = 1; verb == "export" && i + 1 < arguments.size(); ++i) {
    if (arguments[i] == "--to") return verb + " " + arguments[i + 1];
  }
  return verb;
}

bool VerbCase::writes_pictures() const {
  const std::string& verb = arguments.at(0);
  return draws || verb == "compare" || verb == "evaluate" ||
         std::any_of(arguments.begin(), arguments.end(), [](const std::string& word) {
           return word == "--plot" || word == "--picture" || fs::path(word).extension() == ".png";
         });
}

WorkFolder& WorkFolder::instance() {
  static WorkFolder folder;
  return folder;
}

WorkFolder::WorkFolder() {
  fs::create_directories(out());
  make_clouds();
  make_scenes();
  make_imports();
  add_cases();
}

ProgramResult WorkFolder::run(const std::vector<std::string>& arguments,
                              Surroundings surroundings) const {
  surroundings.folder = path();
  // The first of two variables of one name counts.
  surroundings.variables.insert(surroundings.variables.end(),
                                {"DISPLAY=", "OMP_NUM_THREADS=1", "CAMBER_CACHE=cache"});
  return run_camber_in(surroundings, arguments);
}

void WorkFolder::must_run(const std::vector<std::string>& arguments) const {
  const ProgramResult result = run(arguments);
  if (result.exit_code != 0) throw std::runtime_error(arguments[0] + ": " + result.error);
}

void WorkFolder::clear_out() const {
  for (const auto& entry : fs::directory_iterator(out())) fs::remove_all(entry);
}

void WorkFolder::make_clouds() const {
  write_cloud(level_square(0.0), path() / "cloud.ply");
  write_cloud(level_square(1.0), path() / "other.ply");
  for (const char* kind : {"pcd", "las", "laz", "csv", "bin"}) {
    must_run({"convert", "cloud.ply", "--out", std::string("cloud.") + kind});
  }
  must_run({"tiles", "plan", "cloud.laz", "--tile", "25", "--out", "plan"});
  write_bytes(path() / "line.xyz", "x y z\n-15 0 0\n-5 0 0\n5 1 0\n15 2 0\n");
  must_run({"patches", "cloud.ply", "--driven-line", "line.xyz", "--out", "surface"});
  must_run({"export", "surface", "--to", "opencrg", "--out", "road.crg"});
}

void WorkFolder::make_scenes() const {
  must_run({"synth", "--frames", "3", "--size", "320x96", "--supersampling", "1", "--cloud-points",
            "1000", "--out", "scene"});
  must_run({"reconstruct", "scene", "--no-pictures", "--out", "result"});
  // A scene for networks that see red boxes and green pavements.
  fs::create_directories(path() / "plain");
  std::vector<std::uint8_t> pixels(3u * 128 * 64, 0);
  for (int y = 40; y < 48; ++y) {
    for (int x = 24; x < 32; ++x) pixels[3u * (128 * y + x)] = 255;
  }
  write_png(path() / "plain/0.png", 128, 64, 2, 8, pixels);
  write_bytes(path() / "plain/scene.json",
              R"({"format": "camber-scene", "version": 1, "camera": {"width": 128, "height": 64,
                  "fx": 100, "fy": 100, "cx": 64, "cy": 32},
                  "frames": [{"id": 0, "image": "0.png", "vehicles": []}]})");
  const std::string input = R"("input": {"width": 128, "height": 64, "fit": "stretch"})";
  write_bytes(path() / "red.onnx", red_cell_detector(128, 64, 16.0));
  write_bytes(path() / "red.json",
              R"({"format": "camber-network", "version": 1, "task": "detector", )" + input +
                  R"(, "head": "fastestdet", "classes": ["other", "car"], "tiles": false})");
  write_bytes(path() / "colors.onnx", color_segmenter(128, 64));
  write_bytes(path() / "colors.json",
              R"({"format": "camber-network", "version": 1, "task": "segmenter", )" + input +
                  R"(, "head": "argmax", "classes": ["other", "road", "pavement"]})");
  fs::copy_file(source_dir() / "lib/camber/vehicle/shipped_prior.json", path() / "prior.json");
}

void WorkFolder::make_imports() const {
  for (const char* folder : {"images", "model", "SEQ1/RGBLeft", "SEQ1/DepthLeft"}) {
    fs::create_directories(path() / folder);
  }
  for (const std::string id : {"0", "1", "2"}) {
    const auto pixels = picture(80, 60, 3);
    write_png(path() / ("images/00000" + id + ".png"), 80, 60, 2, 8, pixels);
    for (const char* kind : {"RGBLeft", "DepthLeft"}) {
      write_png(path() / "SEQ1" / kind / ("000000" + id + ".png"), 64, 36, 2, 8,
                picture(64, 36, 3));
    }
  }
  const std::map<std::string, std::string> texts = {
      {"calib.txt", "P2: 100 0 40 6 0 100 30 1.3 0 0 1 0.01\n"},
      {"labels.txt", "0 3 Car 0 2 0.1 10 20 30 40 1.5 1.75 4.25 1 1.6 20 0.5\n"},
      {"poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 1\n1 0 0 0 0 1 0 0 0 0 1 2\n"},
      {"times.txt", "0.0\n0.1\n0.2\n"},
      {"speed.csv", "time,speed\n0,9.5\n0.1,9.6\n0.2,9.7\n"},
      {"camera.yaml",
       "image_width: 80\nimage_height: 60\ncamera_matrix: {rows: 3, cols: 3, data: [100, 0, 40, 0, "
       "101, 30, 0, 0, 1]}\ndistortion_model: plumb_bob\ndistortion_coefficients: {rows: 1, cols: "
       "5, data: [-0.1, 0.01, 0.001, 0.002, 0]}\n"},
      {"boxes.json",
       R"({"images": [{"id": 7, "file_name": "000001.png", "width": 80, "height": 60}],
           "categories": [{"id": 3, "name": "Car"}],
           "annotations": [{"image_id": 7, "category_id": 3, "bbox": [10, 20, 30, 20]}]})"},
      {"model/cameras.txt", "1 SIMPLE_RADIAL 80 60 100 40 30 -0.1\n"},
      {"model/images.txt", "5 1 0 0 0 0 0 -2 1 000001.png\n\n7 1 0 0 0 0 0 0 1 000000.png\n\n"},
      {"model/points3D.txt", "1 0.5 1.5 9 100 90 80 0.3 5 0 7 1\n"},
      {"options.toml", "tolerance = 0.02\n"},
      {"matrix.txt", "1 0 0 0\n0 1 0 0\n0 0 1 0.1\n0 0 0 1\n"},
  };
  for (const auto& [name, text] : texts) write_bytes(path() / name, text);
  fs::copy_file(source_dir() / "samples/own_drive/drive.mp4", path() / "drive.mp4");
#ifdef CAMBER_HAS_ROSBAG
  const auto bytes = picture(80, 60, 3);
  std::vector<BagContent> messages = {{"/cam/camera_info", "CameraInfo", RosCameraInfo().bytes()}};
  for (int i = 0; i < 3; ++i) {
    messages.push_back({"/cam/image_raw", "Image",
                        ros_image(1600000000 + 0.1 * i, 80, 60, "bgr8", 240,
                                  std::string(bytes.begin(), bytes.end()))});
  }
  write_bag(path() / "drive.bag", messages, BagCompression::kNone, 30000);
#endif
}

void WorkFolder::add_cases() {
  constexpr bool kSlow = true, kDraws = true, kKeepsItsPart = true;
  cases_ = {
      {{"reconstruct", "scene", "--frames", "0,1", "--no-pictures", "--out", "out/run"},
       {"scene"},
       kSlow},
      {{"reconstruct", "scene", "--frames", "0,1", "--out", "out/pictures"},
       {"scene"},
       kSlow,
       kDraws},
      {{"drive", "scene", "--frames", "0,1", "--out", "out/drive"},
       {"scene"},
       kSlow,
       !kDraws,
       0,
       kKeepsItsPart},
      {{"calibrate", "drive.mp4", "--out", "out/camera.yaml", "--scene", "out/calibrated"},
       {"drive.mp4"},
       kSlow},
      {{"triangulate", "scene", "--frames", "0,1", "--out", "out/road.ply"}, {"scene"}, kSlow},
      {{"vehicles", "scene", "--out", "out/vehicles.json", "--kitti-labels", "out/vehicles.txt",
        "--prior", "prior.json"},
       {"scene/scene.json", "prior.json"}},
      {{"detect", "plain", "--detector", "red.onnx", "--segmenter", "colors.onnx", "--no-cache",
        "--out", "out/detected"},
       {"plain", "red.onnx", "red.json", "colors.onnx", "colors.json"}},
      {{"plane", "cloud.pcd", "--json"}, {"cloud.pcd"}},
      {{"patches", "cloud.ply", "--driven-line", "line.xyz", "--config", "options.toml", "--out",
        "out/patches"},
       {"cloud.ply", "line.xyz", "options.toml"}},
      {{"ground", "cloud.las", "--out", "out/ground.las"}, {"cloud.las"}},
      {{"ground", "cloud.laz", "--out", "out/ground.laz"}, {"cloud.laz"}},
      {{"profile", "surface", "--out", "out/profile.csv", "--plot", "out/profile.svg"},
       {"surface"}},
      {{"profile", "road.crg", "--out", "out/road.json"}, {"road.crg"}},
      {{"lift", "labels.txt", "--surface", "result", "--calib", "calib.txt", "--out",
        "out/lifted.txt"},
       {"labels.txt", "result", "calib.txt"}},
      {{"export", "surface", "--to", "opencrg", "--out", "out/road.crg"}, {"surface"}},
      {{"export", "result", "--to", "opendrive", "--vehicles", "--out", "out/road.xodr"},
       {"result"}},
      {{"export", "result", "--to", "mesh", "--out", "out/road.glb"}, {"result"}},
      {{"export", "result", "--to", "trajectory", "--out", "out/cameras.tum"}, {"result"}},
      {{"export", "result", "--to", "mcap", "--out", "out/result.mcap"}, {"result"}},
      {{"compare", "cloud.csv", "other.ply", "--estimate-from-truth", "matrix.txt", "--out",
        "out/compared"},
       {"cloud.csv", "other.ply", "matrix.txt"},
       kSlow},
      {{"evaluate", "--truth", "scene", "--estimate", "result", "--out", "out/tables"},
       {"scene/scene.json", "result"},
       kSlow},
      {{"render", "result", "--view", "oblique", "--size", "160x90", "--out", "out/view.png"},
       {"result"},
       kSlow,
       kDraws},
      {{"render", "result", "--view", "bev", "--size", "160x90", "--out", "out/bev.png"},
       {"result"}},
      {{"render", "result", "--out", "out/scene.glb"}, {"result"}},
      {{"view", "result"}, {"result"}, !kSlow, kDraws, 3},
      {{"import", "images", "images", "--calib", "camera.yaml", "--times", "times.txt",
        "--detections", "boxes.json", "--speed", "speed.csv", "--poses", "poses.txt", "--out",
        "out/own"},
       {"images", "camera.yaml", "times.txt", "boxes.json", "speed.csv", "poses.txt"}},
      {{"import", "video", "drive.mp4", "--fov", "90", "--every", "20", "--extract", "--out",
        "out/video"},
       {"drive.mp4"},
       kSlow},
      {{"import", "colmap", "model", "--images", "images", "--scale", "2", "--out", "out/colmap"},
       {"model", "images"}},
      {{"import", "kitti", "--images", "images", "--calib", "calib.txt", "--camera", "2",
        "--labels", "labels.txt", "--detections-from-labels", "--poses", "poses.txt", "--out",
        "out/kitti"},
       {"images", "calib.txt", "labels.txt", "poses.txt"}},
      {{"import", "synthia-sf", "--sequence", "SEQ1", "--out", "out/synthia"}, {"SEQ1"}},
      {{"keypoints", "synthesise", "--count", "2", "--size", "16", "--out", "out/crops"},
       {},
       kSlow,
       kDraws},
      {{"keypoints", "run", "scene", "--out", "out/keypoints.json"}, {"scene/scene.json"}, kSlow},
      {{"keypoints", "evaluate", "scene", "--least-height", "5", "--out", "out/evaluated.json"},
       {"scene/scene.json"},
       kSlow},
      {{"prior", "learn", "--family", "--coefficients", "2", "--out", "out/prior.json"}, {}, kSlow},
      {{"prior", "info", "prior.json", "--picture", "out/prior.png"}, {"prior.json"}},
      {{"synth", "--frames", "1", "--size", "64x32", "--supersampling", "1", "--cloud-points",
        "100", "--out", "out/made"},
       {},
       kSlow,
       kDraws},
      {{"info", "cloud.bin", "road.crg", "model", "scene", "result", "--json"},
       {"cloud.bin", "road.crg", "model", "scene/scene.json", "result"}},
      {{"convert", "cloud.csv", "--out", "out/cloud.pcd", "--encoding", "compressed"},
       {"cloud.csv"}},
      {{"convert", "scene/truth/depth/000000.png", "--depth", "kitti", "--camera", "scene", "--out",
        "out/depth.las"},
       {"scene/truth/depth/000000.png", "scene/scene.json"}},
      {{"filter", "cloud.ply", "--voxel", "1", "--out", "out/thin.bin"}, {"cloud.ply"}},
      {{"tiles", "plan", "cloud.laz", "--tile", "25", "--out", "out/plan"},
       {"cloud.laz"},
       !kSlow,
       !kDraws,
       0,
       kKeepsItsPart},
      {{"tiles", "run", "plan", "--job", "normals", "--radius", "3", "--out", "out/normals"},
       {"plan/index.json"},
       !kSlow,
       !kDraws,
       0,
       kKeepsItsPart},
  };
#ifdef CAMBER_HAS_ROSBAG
  cases_.push_back({{"import", "rosbag", "drive.bag", "--out", "out/bag"}, {"drive.bag"}});
#endif
#ifdef CAMBER_HAS_GDAL
  cases_.push_back(
      {{"export", "surface", "--to", "geotiff", "--out", "out/road.tif"}, {"surface"}});
  cases_.push_back({{"export", "cloud.las", "--to", "geotiff", "--hillshade", "out/shade.tif",
                     "--step", "1", "--out", "out/site.tif"},
                    {"cloud.las"}});
  cases_.back().writes_apart = true;
#endif
}

std::map<std::string, std::string> without_timings(std::map<std::string, std::string> files) {
  for (auto& [name, bytes] : files) {
    const std::string kind = fs::path(name).extension();
    if (kind == ".json") {
      json content = json::parse(bytes, nullptr, false);
      if (content.is_discarded()) continue;
      remove_key(content, "timings_ms");
      bytes = content.dump();
    } else if (kind == ".html") {
      bytes = bytes.substr(bytes.size() - std::min<std::size_t>(bytes.size(), 8));
    }
  }
  return files;
}

bool same_but_timings(const std::map<std::string, std::string>& a,
                      const std::map<std::string, std::string>& b) {
  const auto same = [](const auto& one, const auto& other) {
    return one == other ||
           (one.first == other.first && without_timings({one}) == without_timings({other}));
  };
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), same);
}

bool is_long_run() {
  const char* const asked = std::getenv("CAMBER_LONG_TESTS");
  return asked && *asked && std::string(asked) != "0";
}

}  // namespace camber::test
