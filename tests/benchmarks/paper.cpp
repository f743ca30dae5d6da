// The paper's method (preset paper) on steep roads, row by row: its own starts and joint problem
// with the true planes given, one image; and from images, with the planes that RANSAC finds. Truth
// is only compared with, but for the rows that say that they were given the true planes.
//
//   bench_paper [--scenes DIR] [given] [images] [--cars]
//
// Scenes: steep-scenes and steep-scenes-more under $CAMBER_DATA, else ../shared/data; --scenes DIR
// takes another folder of scenes. The vehicles of the middle frame are judged. The weights were
// decided on other scenes (docs/notes/paper.md).

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "benchmarks/report.h"
#include "camber/core/errors.h"
#include "camber/evaluate/tables.h"
#include "camber/pipeline/reconstruct.h"
#include "camber/scene/scene.h"
#include "camber/vehicle/paper/joint_fit.h"
#include "camber/vehicle/support_plane.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

struct SceneSet {
  std::string name;
  std::vector<Scene> scenes;
};

SceneSet read_set(const fs::path& folder) {
  SceneSet out;
  out.name = folder.filename().string();
  std::vector<fs::path> paths;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (fs::exists(entry.path() / "scene.json")) paths.push_back(entry.path());
  }
  std::sort(paths.begin(), paths.end());
  for (const fs::path& path : paths) out.scenes.push_back(read_scene(path));
  return out;
}

const SceneFrame& middle_frame(const Scene& scene) { return scene.frames[scene.frames.size() / 2]; }

const TruthFrame& truth_of(const Scene& scene, int frame) {
  for (const TruthFrame& t : scene.truth->frames) {
    if (t.id == frame) return t;
  }
  throw InputError("scene " + scene.name, "truth.frames", "no truth of the middle frame");
}

/// The true plane of the true vehicle whose box overlaps the detection most; else the true ego
/// plane.
SupportPlane true_support(const Scene& scene, const TruthFrame& truth,
                          const VehicleDetection& detection) {
  VehicleDetection given = detection;
  given.given_plane = *truth.ego_plane;
  double overlap = 0.5;
  for (const TruthVehicle& t : truth.vehicles) {
    const double o = intersection_over_union(t.box.clipped(scene.camera.width, scene.camera.height),
                                             detection.box);
    if (o < overlap) continue;
    overlap = o;
    given.given_plane = *t.plane;
  }
  return given_support(scene.camera, given, {});
}

/// Errors of the middle frame's vehicles, by "scene/truth id".
using Errors = std::map<std::string, VehicleError>;

void add_errors(const Scene& scene, int frame, std::vector<VehicleEstimate> vehicles, Errors* out) {
  VehicleDocument document;
  document.frames.push_back({frame, std::move(vehicles)});
  for (const VehicleError& e : evaluate_vehicles(scene, document).vehicles) {
    (*out)[scene.name + "/" + std::to_string(e.truth_id)] = e;
  }
}

class RowTable {
 public:
  RowTable(bench::Report& report, const std::string& key, const std::string& title,
           const std::string& section)
      : report_(report),
        key_(key),
        cars_(report.flag("--cars")),
        table_(report.table(
            key, title, section,
            {bench::label("row"), bench::value("cars"), bench::lower("centre, mean", "m"),
             bench::lower("centre, median", "m"), bench::lower("centre, <= 15 m", "m"),
             bench::lower("centre, 15 to 30 m", "m"), bench::lower("centre, > 30 m", "m"),
             bench::lower("plane height, median", "m"), bench::value("inside their 95 %", "%"),
             bench::lower("farther off than their start", "%"), bench::value("scenes refused")})) {
    std::printf(
        "\n## %s\n\n| row | cars | mean m | median m | <= 15 m | 15-30 m | > 30 m | plane height m "
        "| "
        "in their 95 %% | farther off than their start | refused |\n"
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
        title.c_str());
  }

  /// @param starts  to compare with; null: none.
  void row(const std::string& name, const Errors& errors, const Errors* starts, int refused = 0) {
    std::vector<double> centre, height, bins[3];
    double inside = 0.0, worse = 0.0;
    bench::Items& items =
        report_.items(key_ + "." + name, {bench::lower("centre", "m"), bench::lower("plane", "m")});
    for (const auto& [car, e] : errors) {
      centre.push_back(e.center_error);
      height.push_back(std::abs(e.height_error));
      bins[e.distance <= 15.0 ? 0 : e.distance <= 30.0 ? 1 : 2].push_back(e.center_error);
      inside += e.center_mahalanobis < 7.815 ? 1.0 : 0.0;
      constexpr double kWorse = 0.1;  // m
      if (starts && e.center_error > starts->at(car).center_error + kWorse) worse += 1.0;
      items.add(car, {e.center_error, std::abs(e.height_error)});
      if (cars_) {
        std::printf("    %s %5.1f m: error %.2f along %+.2f, plane %+.3f, size %.2f, %s\n",
                    car.c_str(), e.distance, e.center_error, e.along_error, e.height_error,
                    e.dimension_error, std::string(to_string(e.status)).c_str());
      }
    }
    const double share = 100.0 / std::max<double>(1.0, static_cast<double>(errors.size()));
    const ErrorSummary all = summarise(centre);
    const double farther = starts ? share * worse : std::nan("");
    std::printf("| %s | %d | %.2f | %.2f | %.2f | %.2f | %.2f | %.3f | %.0f %% | %s | %d |\n",
                name.c_str(), all.count, all.mean, all.median, summarise(bins[0]).mean,
                summarise(bins[1]).mean, summarise(bins[2]).mean, summarise(height).median,
                share * inside, starts ? fmt::format("{:.1f} %", farther).c_str() : "-", refused);
    table_.row({name, all.count, all.mean, all.median, summarise(bins[0]).mean,
                summarise(bins[1]).mean, summarise(bins[2]).mean, summarise(height).median,
                share * inside, farther, refused});
  }

 private:
  bench::Report& report_;
  std::string key_;
  bool cars_;
  bench::Table& table_;
};

/// The joint problem on the true planes, from one image's detections.
void given_planes(bench::Report& report, const SceneSet& set) {
  using namespace paper;
  RowTable table(report, "given." + set.name,
                 set.name + ": true local planes given, one image, preset paper", "given");
  std::vector<std::pair<std::string, JointFitOptions>> rows(10);
  rows[0].first = "meant terms";
  rows[1].first = "printed terms, CGNR with Jacobi";
  rows[1].second.terms = Terms::kPrinted;
  rows[1].second.solver = LinearSolver::kConjugateGradients;
  rows[2].first = "meant, 14 keypoints";
  rows[2].second.keypoint_set = KeypointSet::kSmall14;
  rows[3].first = "printed, 14 keypoints";
  rows[3].second = rows[1].second;
  rows[3].second.keypoint_set = KeypointSet::kSmall14;
  rows[4].first = "meant, no links";
  rows[4].second.links = PlaneLinks::kNone;
  rows[5].first = "meant, continuity for equation 8";
  rows[5].second.links = PlaneLinks::kContinuity;
  rows[6].first = "meant, equation 8 up to 20 m";
  rows[6].second.link_reach = 20.0;
  rows[7].first = "meant, pose and shape in turns";
  rows[7].second.schedule = Schedule::kAlternating;
  rows[8].first = "meant, mean shape";
  rows[8].second.num_coefficients = 0;
  rows[9].first = "meant, 20 coefficients";
  rows[9].second.num_coefficients = 20;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const JointFitOptions& options = rows[r].second;
    Errors joint, start;
    for (const Scene& scene : set.scenes) {
      const SceneFrame& frame = middle_frame(scene);
      std::vector<SupportPlane> supports;
      for (const VehicleDetection& d : frame.vehicles) {
        supports.push_back(true_support(scene, truth_of(scene, frame.id), d));
      }
      StartOptions start_options;
      start_options.keypoint_set = options.keypoint_set;
      const std::vector<VehicleStart> starts =
          starts_on_planes(scene.camera, frame.vehicles, supports, start_options);
      std::vector<VehicleEstimate> begin;
      for (const VehicleStart& s : starts) begin.push_back(s.vehicle);
      add_errors(scene, frame.id, std::move(begin), &start);
      add_errors(scene, frame.id, fit_joint(scene.camera, supports, starts, options).vehicles,
                 &joint);
    }
    if (r == 0) table.row("starts", start, nullptr);
    table.row(rows[r].first, joint, &start);
  }
}

/// The whole run, from images.
void from_images(bench::Report& report, const SceneSet& set) {
  RowTable table(report, "images." + set.name,
                 set.name + ": from images, planes by RANSAC, reconstruct --preset paper",
                 "images");
  struct Row {
    std::string name;
    VehicleMethod method = VehicleMethod::kJoint;
    int images = 3;
    paper::Terms terms = paper::Terms::kMeant;
    PaperScale scale = PaperScale::kEgo;
    KeypointSet keypoints = KeypointSet::kAll36;
  };
  std::vector<Row> rows(8);
  rows[0].name = "joint";
  rows[1] = {"coplanar", VehicleMethod::kCoplanar};
  rows[2] = {"flat", VehicleMethod::kFlat};
  rows[3].name = "joint, printed terms";
  rows[3].terms = paper::Terms::kPrinted;
  rows[4].name = "joint, scale by each patch";
  rows[4].scale = PaperScale::kPatch;
  rows[5].name = "joint, 14 keypoints";
  rows[5].keypoints = KeypointSet::kSmall14;
  rows[6].name = "joint, a pair of images";
  rows[6].images = 2;
  rows[7].name = "joint, one image (level plane at the camera's height)";
  rows[7].images = 1;
  for (const Row& row : rows) {
    Errors errors;
    int refused = 0;
    for (const Scene& scene : set.scenes) {
      const std::size_t middle = scene.frames.size() / 2;
      std::vector<int> frames;
      if (row.images == 3) frames.push_back(scene.frames[middle - 1].id);
      frames.push_back(scene.frames[middle].id);
      if (row.images >= 2) frames.push_back(scene.frames[middle + 1].id);
      ReconstructOptions options;
      options.seed = report.seed();
      options.preset = Preset::kPaper;
      options.vehicles.method = row.method;
      options.vehicles.fit.keypoint_set = row.keypoints;
      options.paper.vehicles.terms = row.terms;
      options.paper.ground.scale = row.scale;
      try {
        Reconstruction result = reconstruct(scene, frames, options);
        for (VehicleFrame& f : result.vehicles.frames) {
          if (f.id == scene.frames[middle].id) {
            add_errors(scene, f.id, std::move(f.vehicles), &errors);
          }
        }
      } catch (const NoAnswerError&) {
        ++refused;
      }
    }
    table.row(row.name, errors, nullptr, refused);
  }
}

void run_paper(bench::Report& report) {
  std::vector<SceneSet> sets;
  if (report.flag("--scenes")) {
    sets.push_back(read_set(report.option("--scenes")));
  } else {
    for (const char* name : {"steep-scenes", "steep-scenes-more"}) {
      const fs::path folder = test::data_dir() / name;
      if (fs::exists(folder)) {
        sets.push_back(read_set(folder));
      } else {
        std::printf("skipped: no %s\n", folder.string().c_str());
      }
    }
  }
  std::printf("# The paper's method on steep roads\n");
  for (const SceneSet& set : sets) {
    if (report.wanted("given")) given_planes(report, set);
    if (report.wanted("images")) from_images(report, set);
  }
}

}  // namespace
}  // namespace camber

int main(int argc, char** argv) {
  using namespace camber;
  const bench::Program program = {"bench_paper",
                                  "The paper's method on steep roads, row by row",
                                  {"given", "images"},
                                  {{"--scenes", "DIR", "Another folder of scenes"},
                                   {"--cars", "", "List every vehicle", false}}};
  return bench::run_program(program, argc, argv, run_paper);
}
