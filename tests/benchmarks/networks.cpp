// Networks against labels and laser scans: a detector on single frames, a segmenter alone and fused
// with geometry, and the main job from images alone. Run with no arguments, or the names of parts;
// --help lists them. Data and networks: $CAMBER_DATA, else ../shared/data.

#include <Eigen/Cholesky>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include "benchmarks/cpu_time.h"
#include "benchmarks/report.h"
#include "camber/cloud/cloud_io.h"
#include "camber/core/memory.h"
#include "camber/detect/shipped_networks.h"
#include "camber/evaluate/metrics.h"
#include "camber/image/image_io.h"
#include "camber/import/import_kitti.h"
#include "camber/import/kitti_labels.h"
#include "camber/pipeline/detect_frames.h"
#include "camber/pipeline/network_file.h"
#include "camber/pipeline/reconstruct.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

const char* const kYoloxNano =
    R"({"format": "camber-network", "version": 1, "task": "detector", "head": "yolox",
        "classes": "coco",
        "input": {"width": 416, "height": 416, "align": "top_left", "colors": "bgr",
                  "range": [0, 255]})";
const char* const kFastestDet =
    R"({"format": "camber-network", "version": 1, "task": "detector", "head": "fastestdet",
        "classes": "coco", "score": 0.6,
        "input": {"width": 352, "height": 352, "fit": "stretch", "colors": "bgr"})";
const char* const kAdas192 =
    R"({"format": "camber-network", "version": 1, "task": "segmenter", "head": "argmax",
        "classes": ["other", "road", "curb", "mark"], "road": ["road", "mark"],
        "pavement": ["curb"],
        "input": {"width": 640, "height": 192, "fit": "stretch", "colors": "bgr",
                  "range": [0, 255]})";
const char* const kAdas288 =
    R"({"format": "camber-network", "version": 1, "task": "segmenter", "head": "argmax",
        "classes": ["other", "road", "curb", "mark"], "road": ["road", "mark"],
        "pavement": ["curb"],
        "input": {"width": 896, "height": 288, "fit": "stretch", "colors": "bgr",
                  "range": [0, 255]})";
const char* const kTwinLiteNet =
    R"({"format": "camber-network", "version": 1, "task": "segmenter", "head": "pairs",
        "classes": ["da", "ll"], "road": ["da", "ll"],
        "input": {"width": 640, "height": 192, "fit": "stretch"})";

const char* const kAdasFile = "road-segmentation-adas-0001_192x640.onnx";
const char* const kYoloxFile = "yolox_nano_coco.onnx";

/// The shared networks with side files written here.
class Networks {
 public:
  explicit Networks(fs::path folder) : folder_(std::move(folder)) {}
  bool available() const { return fs::exists(folder_); }
  fs::path network(const std::string& file) const { return folder_ / file; }
  /// @param text  without its last brace. @param more  keys to add, each after a comma.
  fs::path side_file(const std::string& name, const std::string& text,
                     const std::string& more = "") const {
    const fs::path path = temporary_.path() / name;
    std::ofstream(path) << text << more << "}";
    return path;
  }

 private:
  fs::path folder_;
  test::TemporaryFolder temporary_;
};

bool available(const fs::path& path) {
  if (fs::exists(path)) return true;
  std::printf("skipped: no %s\n", path.string().c_str());
  return false;
}

double share(long part, long all) {
  return all > 0 ? 100.0 * static_cast<double>(part) / static_cast<double>(all) : std::nan("");
}

double quantile(std::vector<double> values, double at) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(at * static_cast<double>(values.size() - 1))];
}

double mean(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double v : values) sum += v;
  return values.empty() ? std::nan("") : sum / static_cast<double>(values.size());
}

double ms_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

// ---- Detectors on single frames -------------------------------------------------------------

constexpr double kLeastHeight = 25.0;  // px

bool is_wanted(const KittiLabel& label) {
  const bool vehicle = label.type == "Car" || label.type == "Van" || label.type == "Truck";
  return vehicle && label.box.height() >= kLeastHeight && label.occluded <= 1 &&
         label.truncated <= 0.5;
}

/// Share of a box inside another.
double inside(const Box2& box, const Box2& other) {
  const Box2 common{std::max(box.x1, other.x1), std::max(box.y1, other.y1),
                    std::min(box.x2, other.x2), std::min(box.y2, other.y2)};
  return common.width() > 0.0 && common.height() > 0.0 ? common.area() / box.area() : 0.0;
}

/// On no labelled object (IoU of 0.5) and by less than half in a region that is not labelled.
bool is_false(const Box2& box, const std::vector<KittiLabel>& labels) {
  return std::none_of(labels.begin(), labels.end(), [&](const KittiLabel& label) {
    return label.dont_care() ? inside(box, label.box) >= 0.5
                             : intersection_over_union(box, label.box) >= 0.5;
  });
}

struct ObjectFigures {
  long wanted = 0, found = 0, detections = 0, wrong = 0;
  std::vector<double> ms, cpu_ms;  // a frame
  std::vector<double> bottom;      // px off, of found boxes in full view
};

void judge_frame(const std::vector<DetectedVehicle>& boxes, const std::vector<KittiLabel>& labels,
                 int height, ObjectFigures& f) {
  std::vector<bool> used(boxes.size());
  for (const KittiLabel& label : labels) {
    if (!is_wanted(label)) continue;
    ++f.wanted;
    double best = 0.5;
    std::size_t at = boxes.size();
    for (std::size_t j = 0; j < boxes.size(); ++j) {
      const double overlap = intersection_over_union(label.box, boxes[j].box);
      if (used[j] || overlap < best) continue;
      best = overlap;
      at = j;
    }
    if (at == boxes.size()) continue;
    used[at] = true;
    ++f.found;
    if (label.occluded == 0 && label.box.y2 < height - 4) {
      f.bottom.push_back(std::abs(boxes[at].box.y2 - label.box.y2));
    }
  }
  for (const DetectedVehicle& box : boxes) {
    if (box.box.height() < kLeastHeight) continue;
    ++f.detections;
    f.wrong += is_false(box.box, labels) ? 1 : 0;
  }
}

void detectors(bench::Report& report, const Networks& networks, const fs::path& folder) {
  std::printf("\n## Detectors, KITTI object frames (19), vehicles of at least 25 px\n");
  if (!networks.available() || !available(folder)) return;
  bench::Table& table = report.table(
      "detectors", "Detectors on the KITTI object frames", "detectors",
      {bench::label("network"), bench::label("tiles"), bench::value("vehicles"),
       bench::higher("found"), bench::value("detections"), bench::lower("false"),
       bench::lower("false share", "%"), bench::lower("lower side, rms", "px"),
       bench::timing("a frame, two threads"), bench::timing("processor time of a frame")});
  struct Row {
    const char *name, *file, *text;  // no file: the one that ships
    bool tiles;
  };
  const auto open = [&](const Row& row) {
    if (row.file == nullptr) {
      return Detector(shipped_detector(),
                      parse_detector_description(shipped_detector_description(), row.name));
    }
    return Detector(networks.network(row.file),
                    read_detector_description(networks.side_file(
                        "detector.json", row.text, row.tiles ? "" : ", \"tiles\": false")));
  };
  for (const Row& row :
       {Row{"shipped", nullptr, nullptr, true}, Row{"YOLOX-Nano", kYoloxFile, kYoloxNano, true},
        Row{"YOLOX-Nano", kYoloxFile, kYoloxNano, false},
        Row{"FastestDet", "FastestDet.onnx", kFastestDet, true}}) {
    const Detector detector = open(row);
    ObjectFigures f;
    std::vector<fs::path> images;
    for (const auto& entry : fs::directory_iterator(folder / "image_2")) {
      images.push_back(entry.path());
    }
    std::sort(images.begin(), images.end());
    for (const fs::path& path : images) {
      const Image image = read_color_image(path);
      const double before = bench::cpu_ms();
      const auto start = std::chrono::steady_clock::now();
      const std::vector<DetectedVehicle> boxes = detector.detect(image, 2);
      f.ms.push_back(ms_since(start));
      f.cpu_ms.push_back(bench::cpu_ms() - before);
      judge_frame(
          boxes,
          read_kitti_labels(folder / "label_2" / path.filename().replace_extension(".txt")).labels,
          image.height, f);
    }
    double squares = 0.0;
    for (const double off : f.bottom) squares += off * off;
    const double rms = std::sqrt(squares / static_cast<double>(f.bottom.size()));
    std::printf(
        "%s%s: %ld of %ld found, %ld of %ld false (%.0f %%), lower side %.1f px rms, "
        "%.0f ms a frame, %.0f ms of the processor\n",
        row.name, row.tiles ? " with tiles" : "", f.found, f.wanted, f.wrong, f.detections,
        share(f.wrong, f.detections), rms, quantile(f.ms, 0.5), quantile(f.cpu_ms, 0.5));
    table.row({row.name, row.tiles ? "with" : "without", f.wanted, f.found, f.detections, f.wrong,
               share(f.wrong, f.detections), rms, quantile(f.ms, 0.5), quantile(f.cpu_ms, 0.5)});
  }
}

// ---- Masks against laser scans ---------------------------------------------------------------

/// A point of a scan and the pixel that shows it.
struct SeenPoint {
  Eigen::Vector3d point;
  std::size_t pixel;
  bool is_road;  ///< may be of the road's middle
};

std::vector<SeenPoint> seen_points(const RoadCloud& scan, const PinholeCamera& camera,
                                   double farthest) {
  std::vector<SeenPoint> out;
  for (const Eigen::Vector3f& point : scan.points) {
    const Eigen::Vector3d p = point.cast<double>();
    if (p.z() < 2.0 || p.z() > farthest) continue;
    const auto pixel = camera.project(p);
    if (!pixel) continue;
    const auto u = std::lround(pixel->x()), v = std::lround(pixel->y());
    if (u < 0 || v < 0 || u >= camera.width || v >= camera.height) continue;
    const bool is_road = std::abs(p.y() - 1.65) < 0.02 * p.z() + 0.4;
    out.push_back({p, static_cast<std::size_t>(v * camera.width + u), is_road});
  }
  return out;
}

/// The road's middle by known points: camera y as a polynomial of z with one cross slope, robustly
/// within 3 m to each side.
class KnownRoad {
 public:
  KnownRoad(const std::vector<SeenPoint>& points, int degree)
      : degree_(degree), by_(Eigen::VectorXd::Zero(degree + 2)) {
    for (int iteration = 0; iteration < 20; ++iteration) {
      Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(by_.size(), by_.size());
      Eigen::VectorXd right = Eigen::VectorXd::Zero(by_.size());
      for (const SeenPoint& seen : points) {
        const Eigen::Vector3d& p = seen.point;
        if (!seen.is_road || std::abs(p.x()) > 3.0 || p.z() > 40.0) continue;
        const double residual = p.y() - row(p).dot(by_);
        // Least squares first: the road may climb.
        const double weight =
            iteration == 0 ? 1.0 : 1.0 / (1.0 + residual * residual / (0.05 * 0.05));
        normal += weight * row(p) * row(p).transpose();
        right += weight * p.y() * row(p);
      }
      by_ = normal.ldlt().solve(right);
    }
  }
  double height(const Eigen::Vector3d& p) const { return row(p).dot(by_) - p.y(); }

 private:
  Eigen::VectorXd row(const Eigen::Vector3d& p) const {
    Eigen::VectorXd out(degree_ + 2);
    for (int k = 0; k <= degree_; ++k) out[k] = std::pow(p.z() / 20.0, k);
    out[degree_ + 1] = p.x();
    return out;
  }
  int degree_;
  Eigen::VectorXd by_;
};

struct MaskFigures {
  long ground = 0, found = 0, far_ground = 0, far_found = 0, road = 0, off = 0;
  long vehicle = 0, vehicle_road = 0;
};

/// Labels (1: road) against points that fall on them.
/// @param vehicles  non-zero: a vehicle's pixel; may be empty.
/// @param degree    of the road along z.
void judge_mask(const Image& labels, const std::vector<SeenPoint>& all, const Image& vehicles,
                int degree, MaskFigures& f) {
  std::vector<SeenPoint> points;
  for (const SeenPoint& seen : all) {
    if (vehicles.empty() || vehicles.data[seen.pixel] == 0) {
      points.push_back(seen);
      continue;
    }
    ++f.vehicle;
    f.vehicle_road += labels.data[seen.pixel] == 1 ? 1 : 0;
  }
  const KnownRoad road(points, degree);
  for (const SeenPoint& seen : points) {
    const bool called = labels.data[seen.pixel] == 1;
    const double height = std::abs(road.height(seen.point));
    f.road += called ? 1 : 0;
    f.off += called && height > 0.2 ? 1 : 0;
    if (height > 0.05 || std::abs(seen.point.x()) > 8.0) continue;
    ++f.ground;
    f.found += called ? 1 : 0;
    if (seen.point.z() < 20.0) continue;
    ++f.far_ground;
    f.far_found += called ? 1 : 0;
  }
}

Scene scene_of(const fs::path& images, const fs::path& calibration, const fs::path& velodyne,
               const std::string& frames, int reference, const fs::path& manifest) {
  KittiImportOptions import;
  import.images = images;
  import.calibration = {calibration};
  import.velodyne = velodyne;
  import.frames = frames;
  import.reference_frame = reference;
  import.camera = 2;
  import_kitti_to(import, manifest);
  return read_scene(manifest);
}

void segmenters(bench::Report& report, const Networks& networks, const fs::path& folder) {
  std::printf("\n## Segmenters alone, KITTI stereo 2015 (4 scenes), points of the scans to 60 m\n");
  if (!networks.available() || !available(folder)) return;
  bench::Table& table = report.table(
      "segmenters", "Segmenters alone on the KITTI stereo 2015 scenes", "segmenters",
      {bench::label("network"), bench::value("layers unfused"), bench::higher("ground found", "%"),
       bench::higher("beyond 20 m", "%"), bench::lower("road off by 0.2 m", "%"),
       bench::lower("vehicles called road", "%"), bench::timing("an image")});
  struct Row {
    const char *name, *file, *text;
  };
  for (const Row& row :
       {Row{"adas-0001 192x640", kAdasFile, kAdas192},
        Row{"adas-0001 288x896", "road-segmentation-adas-0001_288x896.onnx", kAdas288},
        Row{"TwinLiteNet 192x640", "twinlitenet_192x640_cv46.onnx", kTwinLiteNet}}) {
    const Segmenter segmenter(
        networks.network(row.file),
        read_segmenter_description(networks.side_file("segmenter.json", row.text)));
    MaskFigures f;
    std::vector<double> ms;
    for (const int id : {9, 12, 23, 26}) {
      const test::TemporaryFolder temporary;
      const Scene scene = scene_of(folder / "image_02", folder / "calib.txt", folder / "velodyne",
                                   std::to_string(id), id, temporary.path() / "scene.json");
      const Image image = read_color_image(scene.frames[0].image);
      const auto start = std::chrono::steady_clock::now();
      const Image labels = segmenter.segment(image);
      ms.push_back(ms_since(start));
      const fs::path vehicles = folder / "obj_map" / scene.frames[0].image.filename();
      judge_mask(labels, seen_points(read_cloud(scene.truth->cloud), scene.camera, 60.0),
                 read_label_image(vehicles, scene.camera), 2, f);
    }
    const bool unfused = segmenter.network().layers() == "unfused";
    std::printf(
        "%s (%s): %.1f %% of the ground found, %.1f %% beyond 20 m; %.1f %% of what is "
        "called road more than 0.2 m off; %.1f %% of the vehicles; %.0f ms\n",
        row.name, segmenter.network().layers().c_str(), share(f.found, f.ground),
        share(f.far_found, f.far_ground), share(f.off, f.road), share(f.vehicle_road, f.vehicle),
        quantile(ms, 0.5));
    table.row({row.name, unfused ? 1 : 0, share(f.found, f.ground),
               share(f.far_found, f.far_ground), share(f.off, f.road),
               share(f.vehicle_road, f.vehicle), quantile(ms, 0.5)});
  }
}

/// Runs the main job from images alone.
Reconstruction run_with(const bench::Report& report, const NetworkFiles& files, Scene& scene,
                        const std::vector<int>& frames, NetworkView* view) {
  DetectFramesOptions options;
  options.networks = files;
  *view = detect_frames(scene, frames, options);
  put_network_view(*view, &scene);
  ReconstructOptions run;
  run.seed = report.seed();
  run.load.labels = view->labels;
  return reconstruct(scene, frames, run);
}

void fused(bench::Report& report, const Networks& networks, const fs::path& folder) {
  std::printf("\n## Mask fused with geometry, KITTI raw drive 0052, scan to 25 m\n");
  if (!networks.available() || !available(folder)) return;
  bench::Table& table = report.table(
      "fused", "A network's mask fused with geometry, drive 0052, scan to 25 m", "fused",
      {bench::label("frames"), bench::lower("network alone: road off by 0.2 m", "%"),
       bench::lower("fused: road off by 0.2 m", "%"),
       bench::higher("network alone: ground found", "%"),
       bench::higher("fused: ground found", "%")});
  const fs::path side = networks.side_file("segmenter.json", kAdas192);
  for (const std::vector<int>& frames : std::vector<std::vector<int>>{{1, 6, 11}, {0, 5, 10}}) {
    const test::TemporaryFolder temporary;
    Scene scene = scene_of(folder / "image_02", folder / "calib.txt", folder / "velodyne", "0:11",
                           frames[1], temporary.path() / "scene.json");
    const std::vector<SeenPoint> scan =
        seen_points(read_cloud(scene.truth->cloud), scene.camera, 25.0);
    NetworkView view;
    NetworkFiles files;
    files.segmenter = networks.network(kAdasFile);
    files.segmenter_config = side;
    const Reconstruction result = run_with(report, files, scene, frames, &view);
    MaskFigures alone, after;
    judge_mask(view.labels.at(frames[1]), scan, {}, 2, alone);
    judge_mask(result.road_mask, scan, {}, 2, after);
    std::string name = std::to_string(frames[0]);
    for (std::size_t k = 1; k < frames.size(); ++k) name += "," + std::to_string(frames[k]);
    std::printf(
        "frames %s: called road and more than 0.2 m off: %.1f %%, fused %.1f %%; ground "
        "found %.1f %%, fused %.1f %%\n",
        name.c_str(), share(alone.off, alone.road), share(after.off, after.road),
        share(alone.found, alone.ground), share(after.found, after.ground));
    table.row({name, share(alone.off, alone.road), share(after.off, after.road),
               share(alone.found, alone.ground), share(after.found, after.ground)});
  }
}

/// The pixels of a depth image, every second one in each direction.
std::vector<SeenPoint> seen_points(const DepthImage& depth, const Image& labels, int road_label,
                                   const PinholeCamera& camera, double farthest) {
  std::vector<SeenPoint> out;
  for (int v = 0; v < depth.height; v += 2) {
    for (int u = 0; u < depth.width; u += 2) {
      const auto at = static_cast<std::size_t>(v * depth.width + u);
      const double z = depth.metres[at];
      if (!(z > 2.0 && z < farthest)) continue;
      out.push_back({camera.ray({u, v}) * z, at, labels.data[at] == road_label});
    }
  }
  return out;
}

/// Rendered scenes, their masks (side streets are road there) taken for a network's, the last three
/// frames with the last one as reference, whose depth is known.
void fused_steep(bench::Report& report, const fs::path& folder) {
  std::printf("\n## Masks of the rendered steep scenes fused with geometry, to 25 m\n");
  if (!available(folder)) return;
  bench::Table& table = report.table(
      "fused_steep", "Masks of rendered steep scenes fused with geometry, to 25 m", "fused",
      {bench::label("scene"), bench::lower("mask alone: road off by 0.2 m", "%"),
       bench::lower("fused: road off by 0.2 m", "%"),
       bench::higher("mask alone: ground found", "%"), bench::higher("fused: ground found", "%")});
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (!fs::exists(entry.path() / "scene.json")) continue;
    Scene scene = read_scene(entry.path());
    const int last = scene.frames.back().id;
    scene.reference_frame = last;
    scene.segmentation_source = "network:simulated";
    const TruthFrame& truth = scene.truth->frames.back();
    const bool kitti = truth.depth_encoding == "kitti";
    Image vehicles = read_label_image(truth.label, scene.camera);
    const std::vector<SeenPoint> points =
        seen_points(read_depth_image(truth.depth, truth.depth_encoding, scene.camera), vehicles,
                    kitti ? 7 : 1, scene.camera, 25.0);
    for (std::uint8_t& label : vehicles.data) label = label == (kitti ? 26 : 14) ? 1 : 0;
    ReconstructOptions options;
    options.seed = report.seed();
    const Reconstruction result = reconstruct(scene, {last - 2, last - 1, last}, options);
    MaskFigures alone, after;
    judge_mask(read_label_image(scene.frames.back().segmentation, scene.camera), points, vehicles,
               4, alone);
    judge_mask(result.road_mask, points, vehicles, 4, after);
    const std::string name = entry.path().filename().string();
    std::printf(
        "%s: called road and more than 0.2 m off: %.1f %%, fused %.1f %%; ground found "
        "%.1f %%, fused %.1f %%\n",
        name.c_str(), share(alone.off, alone.road), share(after.off, after.road),
        share(alone.found, alone.ground), share(after.found, after.ground));
    table.row({name, share(alone.off, alone.road), share(after.off, after.road),
               share(alone.found, alone.ground), share(after.found, after.ground)});
  }
}

// ---- The main job from images alone ------------------------------------------------------------

struct TrackingFigures {
  long wanted = 0, found = 0;
  std::vector<double> heights;  // m, below 25 m
};

void judge_clip(const Scene& scene, const Reconstruction& result,
                const std::vector<KittiLabel>& labels, TrackingFigures& f) {
  for (const VehicleFrame& frame : result.vehicles.frames) {
    for (const KittiLabel& label : labels) {
      if (label.frame != frame.id || label.type != "Car" || label.occluded > 1 ||
          label.location.norm() >= 35.0) {
        continue;
      }
      ++f.wanted;
      f.found += std::any_of(frame.vehicles.begin(), frame.vehicles.end(),
                             [&](const VehicleEstimate& v) {
                               return v.status != Status::kFailed &&
                                      intersection_over_union(v.box, label.box) >= 0.5;
                             })
                     ? 1
                     : 0;
    }
  }
  const SceneMetrics metrics = evaluate_scene(scene, result.surface, result.vehicles, result.run);
  for (const VehicleError& error : metrics.vehicles) {
    if (error.distance >= 25.0) continue;
    // The label of track 1 is an upright box on a cross slope: its bottom is 0.16 m too low.
    f.heights.push_back(std::abs(error.height_error - (error.truth_id == 1 ? 0.16 : 0.0)));
  }
}

void tracking(bench::Report& report, const Networks& networks, const fs::path& folder) {
  std::printf("\n## KITTI tracking 0009 from images alone: boxes and masks of networks\n");
  if (!networks.available() || !available(folder)) return;
  bench::Table& table =
      report.table("tracking", "KITTI tracking 0009 from images alone", "tracking",
                   {bench::label("masks"), bench::label("frames"),
                    bench::value("labelled cars nearer than 35 m"), bench::higher("found", "%"),
                    bench::value("vehicles below 25 m"), bench::lower("height error, mean", "m")});
  KittiImportOptions import;
  import.images = folder / "image_02";
  import.calibration = {folder / "calib_0009.txt"};
  import.labels = folder / "label_02_0009.txt";
  const std::vector<KittiLabel> labels = read_kitti_labels(import.labels).labels;
  NetworkFiles files;
  files.detector = networks.network(kYoloxFile);
  files.detector_config = networks.side_file("detector.json", kYoloxNano);
  for (const bool masks : {true, false}) {
    files.segmenter = masks ? networks.network(kAdasFile) : fs::path();
    files.segmenter_config = networks.side_file("segmenter.json", kAdas192);
    TrackingFigures all;
    for (int first = 48; first <= 51; ++first) {
      Scene scene = import_kitti(import);
      NetworkView view;
      const Reconstruction result =
          run_with(report, files, scene, {first, first + 1, first + 2}, &view);
      TrackingFigures f;
      judge_clip(scene, result, labels, f);
      const std::string name = std::to_string(first) + "-" + std::to_string(first + 2);
      std::printf("%s, frames %s: %ld of %ld found; height error below 25 m mean %.3f m (%zu)\n",
                  masks ? "masks" : "no masks", name.c_str(), f.found, f.wanted, mean(f.heights),
                  f.heights.size());
      table.row({masks ? "network" : "none", name, f.wanted, share(f.found, f.wanted),
                 f.heights.size(), mean(f.heights)});
      all.wanted += f.wanted;
      all.found += f.found;
      all.heights.insert(all.heights.end(), f.heights.begin(), f.heights.end());
    }
    std::printf("%s: %ld of %ld found (%.0f %%); height error below 25 m mean %.3f m (%zu)\n",
                masks ? "masks" : "no masks", all.found, all.wanted, share(all.found, all.wanted),
                mean(all.heights), all.heights.size());
    table.row({masks ? "network" : "none", "all", all.wanted, share(all.found, all.wanted),
               all.heights.size(), mean(all.heights)});
  }
}

void run_networks(bench::Report& report) {
  const fs::path data = test::data_dir();
  const Networks networks(data / "networks");
  if (!networks.available()) std::printf("skipped: no networks in %s\n", data.string().c_str());
  if (report.wanted("detectors")) detectors(report, networks, data / "kitti-object-frames");
  if (report.wanted("segmenters")) segmenters(report, networks, data / "kitti-stereo2015-scenes");
  if (report.wanted("fused")) fused(report, networks, data / "kitti-raw-2011_09_26-drive_0052");
  if (report.wanted("fused")) fused_steep(report, data / "steep-scenes");
  if (report.wanted("tracking")) tracking(report, networks, data / "kitti-tracking-0009-clip");
}

}  // namespace
}  // namespace camber

int main(int argc, char** argv) {
  using namespace camber;
  keep_freed_memory();  // as the command does
  const bench::Program program = {"bench_networks",
                                  "Detectors and segmenters against labels and laser scans",
                                  {"detectors", "segmenters", "fused", "tracking"},
                                  {}};
  return bench::run_program(program, argc, argv, run_networks);
}
