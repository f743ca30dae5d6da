// camber lift on KITTI tracking 0009: label boxes moved along their rays, put on the surface of a
// run, against the labels. Every row of the six frames counts, those of frames that the run does
// not know too. --seed is that of the first of the ten draws. Data: $CAMBER_DATA, else
// ../shared/data.

#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include "benchmarks/report.h"
#include "camber/core/random.h"
#include "camber/import/import_kitti.h"
#include "camber/pipeline/lift_box.h"
#include "camber/pipeline/reconstruct.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr int kDraws = 10;
const char* const kBins[] = {"< 15 m", "15-30 m", "> 30 m"};

/// How the labels are spoilt. Their sizes and 2D boxes stand for a detector's: KITTI's 2D boxes are
/// the projected 3D boxes to about 0.3 px.
struct Noise {
  std::string name;
  double depth = 0.08;     ///< share, along the ray of the bottom centre
  double height = 0.0;     ///< share, of the 3D height
  double side_px = 0.0;    ///< px, each side of the 2D box
  bool of_centre = false;  ///< along the ray of the box's centre instead
};

Eigen::Vector3d centre_of(const KittiLabel& label) {
  return label.location - Eigen::Vector3d(0.0, 0.5 * label.height, 0.0);
}

/// The middle of a lifted box: half its height above the bottom's middle.
Eigen::Vector3d centre_of(const LiftedBox& box) {
  return box.label.location +
         0.5 * box.label.height * rotation_of(box.label.rotation_y, box.tilt).col(1);
}

KittiLabel spoil(const KittiLabel& truth, const Noise& noise, const CounterRandom& random,
                 std::uint64_t row) {
  KittiLabel out = truth;
  const auto draw = [&](std::uint64_t k) { return random.normal(8 * row + k); };
  const double factor = 1.0 + noise.depth * draw(0);
  out.height = truth.height * (1.0 + noise.height * draw(1));
  if (noise.of_centre) {
    out.location = factor * centre_of(truth) + Eigen::Vector3d(0.0, 0.5 * out.height, 0.0);
  } else {
    out.location = factor * truth.location;
  }
  out.box.x1 += noise.side_px * draw(2);
  out.box.y1 += noise.side_px * draw(3);
  out.box.x2 += noise.side_px * draw(4);
  out.box.y2 += noise.side_px * draw(5);
  return out;
}

/// Sums over rows of one bin.
struct Figures {
  int rows = 0, on_surface = 0, by_box = 0, inside = 0;
  double unlifted = 0.0, lifted = 0.0;
};

/// The clip, its calibration and its true rows.
struct Clip {
  Scene scene;
  KittiCalibration::Camera camera;
  std::vector<KittiLabel> truth;  ///< rows with a 3D box
};

Clip load(const fs::path& folder) {
  KittiImportOptions import;
  import.images = folder / "image_02";
  import.calibration = {folder / "calib_0009.txt"};
  import.labels = folder / "label_02_0009.txt";
  import.detections_from_labels = true;
  Clip out;
  out.scene = import_kitti(import);
  out.camera = read_kitti_calibration(import.calibration).camera(2);
  for (const KittiLabel& label : read_kitti_labels(import.labels).labels) {
    if (!label.dont_care() && label.has_box3()) out.truth.push_back(label);
  }
  return out;
}

void lift_rows(const Clip& clip, const RoadSurface& surface, const std::map<int, SE3>& cameras,
               const Noise& noise, const CounterRandom& random, const std::string& key,
               bench::Items& items, std::map<int, Figures>& figures) {
  for (std::size_t row = 0; row < clip.truth.size(); ++row) {
    const KittiLabel& truth = clip.truth[row];
    const KittiLabel moved = spoil(truth, noise, random, row);
    std::optional<SE3> pose;
    if (const auto at = cameras.find(truth.frame); at != cameras.end()) pose = at->second;
    LiftOptions options;
    options.depth_sigma = noise.depth;  // a user knows the detector
    const LiftedBox lifted = lift_box(moved, surface, pose, clip.camera, options);
    const Eigen::Vector3d right = centre_of(truth);
    const Eigen::Vector3d error = centre_of(lifted) - right;
    const double distance = right.norm(), along = error.dot(right) / distance;
    Figures& f = figures[distance < 15.0 ? 0 : distance <= 30.0 ? 1 : 2];
    ++f.rows;
    f.on_surface += lifted.by_surface;
    f.by_box += lifted.by_box;
    f.inside += std::abs(along) <= 1.96 * lifted.sigma_depth;
    f.unlifted += (centre_of(moved) - right).norm();
    f.lifted += error.norm();
    items.add(key + "/" + std::to_string(truth.frame) + "/" + std::to_string(truth.track),
              {error.norm(), (centre_of(moved) - right).norm(), lifted.sigma_depth});
  }
}

void run_clip(bench::Report& report, const Clip& clip, int first, int last) {
  std::vector<int> ids;
  for (int id = first; id <= last; ++id) ids.push_back(id);
  ReconstructOptions options;
  options.seed = report.seed();
  const Reconstruction run = reconstruct(clip.scene, ids, options);
  const RoadSurface surface = surface_without_vehicles(run.surface);
  std::map<int, SE3> cameras;
  for (const auto& c : run.run.cameras) cameras[c.id] = c.reference_from_camera.inverse();
  const std::string frames = std::to_string(first) + "-" + std::to_string(last);
  const Noise noises[] = {{"8 %", 0.08, 0.0, 0.0, false},
                          {"8 %, centre's ray", 0.08, 0.0, 0.0, true},
                          {"8 %, heights 5 %", 0.08, 0.05, 0.0, false},
                          {"8 %, heights 5 %, sides 2 px", 0.08, 0.05, 2.0, false},
                          {"2 %", 0.02, 0.0, 0.0, false},
                          {"20 %, heights 5 %, sides 2 px", 0.20, 0.05, 2.0, false}};
  std::printf("\n## KITTI tracking 0009, all rows of frames 48 to 53, surface of frames %s\n",
              frames.c_str());
  bench::Table& table = report.table(
      "lift." + frames, "Label boxes moved along their rays, surface of frames " + frames, "",
      {bench::label("noise"), bench::label("seeds"), bench::label("distance"), bench::value("rows"),
       bench::value("centre error unlifted, mean", "m"), bench::lower("lifted, mean", "m"),
       bench::value("on the surface", "%"), bench::value("2D box used", "%"),
       bench::value("inside their 95 % along the ray", "%")});
  for (const Noise& noise : noises) {
    bench::Items& items = report.items(
        "lift." + frames + "." + noise.name,
        {bench::lower("centre", "m"), bench::value("unlifted", "m"), bench::value("sigma", "m")});
    std::map<int, Figures> figures[2];  // of even and odd draws
    for (int draw = 0; draw < kDraws; ++draw) {
      lift_rows(clip, surface, cameras, noise,
                CounterRandom(report.seed() + static_cast<std::uint64_t>(draw)),
                std::to_string(draw), items, figures[draw % 2]);
    }
    for (int odd = 0; odd < 2; ++odd) {
      for (const auto& [bin, f] : figures[odd]) {
        const double share = 100.0 / f.rows;
        std::printf(
            "%-30s %-4s %-8s %4d rows: %.3f m unlifted, %.3f m lifted; %.0f %% on the surface, "
            "%.0f %% with their 2D box; %.0f %% inside their 95 %%\n",
            noise.name.c_str(), odd ? "odd" : "even", kBins[bin], f.rows, f.unlifted / f.rows,
            f.lifted / f.rows, share * f.on_surface, share * f.by_box, share * f.inside);
        table.row({noise.name, odd ? "odd" : "even", kBins[bin], f.rows, f.unlifted / f.rows,
                   f.lifted / f.rows, share * f.on_surface, share * f.by_box, share * f.inside});
      }
    }
  }
}

void run_lift(bench::Report& report) {
  const fs::path folder = test::data_dir() / "kitti-tracking-0009-clip";
  if (!fs::exists(folder)) {
    std::printf("skipped: no %s\n", folder.string().c_str());
    return;
  }
  const Clip clip = load(folder);
  run_clip(report, clip, 48, 50);
  run_clip(report, clip, 48, 53);
}

}  // namespace
}  // namespace camber

int main(int argc, char** argv) {
  using namespace camber;
  const bench::Program program = {
      "bench_lift", "Detectors' boxes put on the road surface, against labels", {}, {}};
  return bench::run_program(program, argc, argv, run_lift);
}
