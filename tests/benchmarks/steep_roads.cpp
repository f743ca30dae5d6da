// The vehicles of steep roads by the three methods: 3D errors by distance, with planes from images
// and with the true planes, rows kept apart; and real keypoints on real cars. Truth is only
// compared with, but for the rows that say that they were given the true planes.
//
//   bench_steep_roads [--keep DIR] [--made DIR] [--cars] [--prior FILE]
//                     [--only steep|synth|real|budget]
//
// The scenes are those of steep-scenes and eight of the program's own (camber synth).
// --keep DIR  stores the made scenes and the roads found in the images in DIR and takes them from
//             there next time, so that only the vehicles are fitted again; --made DIR the made
//             scenes alone, so that two revisions see the same images; --cars lists every vehicle;
//             --only runs one part. The budget of the error along the ray is printed by --only
//             budget alone.
// The seed is that of reconstruct() and of the made scenes.
// Data: $CAMBER_DATA, else ../shared/data.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "benchmarks/report.h"
#include "benchmarks/steep_road_clips.h"
#include "camber/core/errors.h"
#include "camber/evaluate/tables.h"
#include "camber/pipeline/reconstruct.h"
#include "camber/scene/results.h"
#include "camber/vehicle/fit_vehicle.h"
#include "camber/vehicle/support_plane.h"
#include "camber/vehicle/vehicle_tracks.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;
const Eigen::Vector3d kUp(0.0, -1.0, 0.0);

/// The plane under a detection as the run found it.
SupportPlane found_support(const Road& road, int frame, const VehicleDetection& detection) {
  SE3 frame_from_reference;
  for (const RunDocument::CameraPose& camera : road.run.cameras) {
    if (camera.id == frame) frame_from_reference = camera.reference_from_camera.inverse();
  }
  for (const VehicleFrame& f : road.vehicles.frames) {
    if (f.id != frame) continue;
    for (const VehicleEstimate& v : f.vehicles) {
      if (v.id != detection.id) continue;
      const int id = v.plane_source.rfind("patch ", 0) == 0 ? std::stoi(v.plane_source.substr(6))
                                                            : road.surface.ego_patch;
      const PlanePatch* patch = road.surface.find(id);
      SupportPlane out;
      // By the road alone: the vehicles are about to enter again.
      const UncertainPlane& plane = patch->without_vehicle ? *patch->without_vehicle : patch->plane;
      out.plane = plane.transformed(frame_from_reference);
      out.source = v.plane_source;
      out.status = patch->status;
      return out;
    }
  }
  throw std::runtime_error("no plane for a detection");
}

using Supports = std::function<SupportPlane(const Clip&, int frame, const VehicleDetection&)>;

SupportPlane unknown_plane(SupportPlane support) {
  support.plane.covariance = Eigen::Vector3d(0.25, 0.25, 400.0).asDiagonal();
  support.status = Status::kOk;
  return support;
}

/// The true plane of the true vehicle whose box overlaps the detection most.
const TruthVehicle* true_vehicle(const Clip& clip, int frame, const VehicleDetection& detection) {
  const TruthVehicle* best = nullptr;
  double overlap = 0.5;
  for (const TruthVehicle& t : truth_of(clip.scene, frame).vehicles) {
    const Box2 box = t.box.clipped(clip.scene.camera.width, clip.scene.camera.height);
    const double o = intersection_over_union(box, detection.box);
    if (o >= overlap) {
      overlap = o;
      best = &t;
    }
  }
  return best;
}

SupportPlane true_support(const Clip& clip, int frame, const VehicleDetection& detection) {
  VehicleDetection given = detection;
  const TruthVehicle* t = true_vehicle(clip, frame, detection);
  given.given_plane = t ? *t->plane : *truth_of(clip.scene, frame).ego_plane;
  return given_support(clip.scene.camera, given, {});
}

struct Row {
  const char* name;
  const char* planes;
  Supports support;
  VehicleFitOptions fit;
  // The frames of that road, with the tracks that the program finds; none: the middle one alone.
  const Road Clip::*views = nullptr;
  bool images = true;   // and the vehicles' grey values
  bool shared = false;  // the vehicles tell each other of the ground
};

EvaluatedScene evaluate_clip(const Clip& clip, const Row& row) {
  std::vector<TrackFrame> frames;
  std::size_t middle = 0;
  const RunDocument& run = row.views ? (clip.*row.views).run : clip.five.run;
  for (const RunDocument::CameraPose& camera : run.cameras) {
    if (!row.views && camera.id != clip.middle) continue;
    const SceneFrame& frame = *clip.scene.find_frame(camera.id);
    if (camera.id == clip.middle) middle = frames.size();
    TrackFrame out;
    out.world_from_camera = camera.reference_from_camera;
    out.time_s = frame.time_s.value_or(camera.id / clip.scene.frame_rate.value_or(10.0));
    if (row.images) out.image = &clip.images.at(camera.id);
    out.detections = frame.vehicles;
    for (const VehicleDetection& d : frame.vehicles) {
      out.supports.push_back(row.support(clip, camera.id, d));
    }
    out.estimates = fit_vehicles(clip.scene.camera, out.detections, out.supports, row.fit);
    frames.push_back(std::move(out));
  }
  VehicleDocument document;
  document.method = row.name;
  document.frames.push_back(
      {clip.middle, row.views ? fit_tracks(clip.scene.camera, frames, row.fit, 0, run.scale_sigma,
                                           row.shared ? &(clip.*row.views).ground : nullptr)
                                    .estimates[middle]
                              : frames[middle].estimates});
  EvaluatedScene out;
  out.scene = clip.scene.name;
  out.method = row.name;
  out.metrics = evaluate_vehicles(clip.scene, document);
  return out;
}

/// Mean error that the stated standard deviations of the depths expect.
double expected_error(const std::vector<EvaluatedScene>& scenes) {
  double sum = 0.0, count = 0.0;
  for (const EvaluatedScene& scene : scenes) {
    for (const VehicleError& e : scene.metrics.vehicles) {
      if (!std::isfinite(e.depth_sigma)) continue;
      sum += std::sqrt(2.0 / 3.14159265358979323846) * e.depth_sigma;
      count += 1.0;
    }
  }
  return sum / std::max(count, 1.0);
}

/// The printed table of methods, its JSON, and every car's values.
class MethodTable {
 public:
  /// @param part  what --only takes; @param key  of the tables.
  MethodTable(bench::Report& report, const std::string& part, const std::string& key,
              const std::string& title)
      : report_(report),
        key_(key),
        table_(report.table(
            key, title, "--only " + part,
            {bench::label("method"), bench::label("planes"), bench::value("cars"),
             bench::lower("centre, mean", "m"), bench::value("its deviation", "m"),
             bench::lower("centre, median", "m"), bench::lower("centre, <= 15 m", "m"),
             bench::lower("centre, <= 30 m", "m"), bench::lower("centre, > 30 m", "m"),
             bench::lower("yaw, median", "deg"), bench::lower("plane height, median", "m"),
             bench::lower("keypoints, median", "m"), bench::value("centres inside their 95 %", "%"),
             bench::lower("unanswered", "%"),
             bench::value("mean that the covariances expect", "m")})) {
    std::printf(
        "| method | planes | cars | mean (std) m | median m | <= 15 m | <= 30 m | > 30 m | yaw "
        "median deg | plane height m | keypoints m | centre in its 95 %% | unanswered | mean "
        "expected by its covariances m |\n"
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n");
  }

  void row(const char* planes, const std::vector<EvaluatedScene>& scenes) {
    const MethodTables t = make_tables(scenes).front();
    const auto bin = [&](const char* name) -> const LocalisationRow& {
      for (const LocalisationRow& r : t.rows) {
        if (r.name == name) return r;
      }
      throw std::runtime_error("no such row");
    };
    const LocalisationRow& all = bin("all");
    std::printf(
        "| %s | %s | %d | %.2f (%.2f) | %.2f | %.2f | %.2f | %.2f | %.2f | %.3f | %.2f | %.0f %% | "
        "%.1f %% | %.2f |\n",
        t.method.c_str(), planes, all.center.count, all.center.mean, all.center.deviation,
        all.center.median, bin("<= 15 m").center.mean, bin("<= 30 m").center.mean,
        bin("> 30 m").center.mean, all.yaw.median * kDegrees, all.height.median,
        bin("all").keypoint.median, 100.0 * all.center_within_95, 100.0 * t.unanswered_share,
        expected_error(scenes));
    table_.row({t.method, planes, all.center.count, all.center.mean, all.center.deviation,
                all.center.median, bin("<= 15 m").center.mean, bin("<= 30 m").center.mean,
                bin("> 30 m").center.mean, all.yaw.median * kDegrees, all.height.median,
                all.keypoint.median, 100.0 * all.center_within_95, 100.0 * t.unanswered_share,
                expected_error(scenes)});
    bench::Items& items =
        report_.items(key_ + "." + t.method + " (" + planes + ")",
                      {bench::lower("centre", "m"), bench::lower("along the ray, absolute", "m"),
                       bench::value("along the ray", "m"), bench::value("depth's sigma", "m"),
                       bench::value("inside its 95 %"), bench::lower("yaw, absolute", "deg"),
                       bench::lower("plane height, absolute", "m"), bench::lower("keypoints", "m"),
                       bench::higher("answered")});
    for (const EvaluatedScene& scene : scenes) {
      for (const VehicleError& e : scene.metrics.vehicles) {
        items.add(scene.scene + "/" + std::to_string(e.truth_id),
                  {e.center_error, std::abs(e.along_error), e.along_error, e.depth_sigma,
                   e.center_mahalanobis < 7.815 ? 1.0 : 0.0, std::abs(e.yaw_error) * kDegrees,
                   std::abs(e.height_error), e.keypoint_error, e.answered ? 1.0 : 0.0});
      }
    }
  }

 private:
  bench::Report& report_;
  std::string key_;
  bench::Table& table_;
};

void list_cars(const std::vector<EvaluatedScene>& scenes) {
  for (const EvaluatedScene& scene : scenes) {
    for (const VehicleError& e : scene.metrics.vehicles) {
      std::printf(
          "    %s %2d %5.1f m: error %.2f along %+.2f sigmas %.2f, plane %+.3f +- %.3f, yaw %+.1f, "
          "size %.2f, keypoints %.2f, %s\n",
          scene.scene.c_str(), e.truth_id, e.distance, e.center_error, e.along_error,
          std::sqrt(e.center_mahalanobis), e.height_error, e.height_sigma, e.yaw_error * kDegrees,
          e.dimension_error, e.keypoint_error, std::string(to_string(e.status)).c_str());
    }
  }
}

/// What the parts of the program share.
struct Bench {
  bench::Report& report;
  const VehiclePrior* prior = nullptr;
  bool cars = false;  ///< list every vehicle
};

void steep_roads(const Bench& bench, const std::vector<Clip>& clips, const std::string& part,
                 const std::string& title) {
  VehicleFitOptions doubting;
  doubting.prior = bench.prior;
  VehicleFitOptions trusting = doubting;
  trusting.plane_is_exact = true;
  const auto level = [](const Clip& clip, int, const VehicleDetection&) {
    return certain_support({kUp, *clip.scene.height_above_road}, "level");
  };
  const auto found_ego = [](const Clip& clip, int, const VehicleDetection&) {
    SE3 here;
    for (const auto& camera : clip.three.run.cameras) {
      if (camera.id == clip.middle) here = camera.reference_from_camera.inverse();
    }
    const PlanePatch* ego = clip.three.surface.find(clip.three.surface.ego_patch);
    return certain_support(ego->plane.transformed(here).plane, "ego");
  };
  const auto found = [](const Clip& clip, int frame, const VehicleDetection& d) {
    return found_support(clip.three, frame, d);
  };
  const auto found_by_five = [](const Clip& clip, int frame, const VehicleDetection& d) {
    return found_support(clip.five, frame, d);
  };
  const auto none = [&](const Clip& clip, int frame, const VehicleDetection& d) {
    return unknown_plane(found_support(clip.three, frame, d));
  };
  const auto true_ego = [](const Clip& clip, int, const VehicleDetection&) {
    return certain_support(*truth_of(clip.scene, clip.middle).ego_plane, "ego");
  };
  const Row rows[] = {
      {"flat", "none", level, trusting},
      {"coplanar", "from 3 images", found_ego, trusting},
      {"joint", "from 3 images", found, doubting},
      {"joint", "from 5 images", found_by_five, doubting},
      {"joint, three views", "from 3 images", found, doubting, &Clip::three, true, true},
      {"joint, three views, each by itself", "from 3 images", found, doubting, &Clip::three},
      {"joint, five views", "from 5 images", found_by_five, doubting, &Clip::five, true, true},
      {"joint, five views, each by itself", "from 5 images", found_by_five, doubting, &Clip::five},
      {"joint, five views, no grey values", "from 5 images", found_by_five, doubting, &Clip::five,
       false, true},
      {"joint without planes", "none", none, doubting},
      {"coplanar", "true ego plane", true_ego, trusting},
      {"joint", "true", true_support, doubting},
      {"joint, five views", "true", true_support, doubting, &Clip::five},
  };
  MethodTable table(bench.report, part, part, title);
  for (const Row& row : rows) {
    std::vector<EvaluatedScene> scenes;
    for (const Clip& clip : clips) scenes.push_back(evaluate_clip(clip, row));
    table.row(row.planes, scenes);
    if (bench.cars) list_cars(scenes);
  }
}

/// Where the error along the viewing ray comes from, by distance: the planes' own errors at the
/// true contact against what they state, and the centres with planes from images, without planes,
/// with true planes, and with true planes made wrong by a known amount that their covariance
/// states.
void budget(const Bench& bench, const std::vector<Clip>& clips) {
  VehicleFitOptions fit;
  using Errors = std::vector<std::map<int, VehicleError>>;  // [clip][detection]
  const auto run = [&](const Supports& support) {
    Errors out;
    for (const Clip& clip : clips) {
      out.emplace_back();
      const Row row{"", "", support, fit};
      for (const VehicleError& e : evaluate_clip(clip, row).metrics.vehicles) {
        out.back()[e.estimate_id] = e;
      }
    }
    return out;
  };
  const auto found = [](const Clip& clip, int frame, const VehicleDetection& d) {
    return found_support(clip.three, frame, d);
  };
  const auto none = [](const Clip& clip, int frame, const VehicleDetection& d) {
    return unknown_plane(found_support(clip.three, frame, d));
  };
  const auto raised = [](double height) {
    return [height](const Clip& clip, int frame, const VehicleDetection& d) {
      SupportPlane s = true_support(clip, frame, d);
      s.plane.covariance = Eigen::Vector3d(1e-4, 1e-4, height * height).asDiagonal();
      s.plane.plane.offset += height;
      return s;
    };
  };
  const Errors joint = run(found), alone = run(none), sure = run(true_support);
  std::vector<Errors> wrong;
  for (const double height : {0.05, -0.05, 0.1, -0.1}) wrong.push_back(run(raised(height)));
  std::printf(
      "\n## Budget of the error along the viewing ray, one view, planes from 3 images\n\n"
      "| distance | cars | plane error rms m | over its stated sigma | joint m | no planes | true "
      "planes | 0.05 m off | 0.1 m off |\n|---|---:|---:|---:|---:|---:|---:|---:|---:|\n");
  bench::Table& table = bench.report.table(
      "budget", "Budget of the error along the viewing ray, one view, planes from 3 images",
      "--only budget",
      {bench::label("distance"), bench::value("cars"), bench::lower("plane error, rms", "m"),
       bench::value("over its stated sigma, rms"), bench::lower("joint", "m"),
       bench::lower("no planes", "m"), bench::lower("true planes", "m"),
       bench::lower("0.05 m off", "m"), bench::lower("0.1 m off", "m")});
  const double edges[] = {0.0, 15.0, 30.0, 1e9};
  const char* names[] = {"<= 15 m", "15-30 m", "> 30 m"};
  for (int bin = 0; bin < 3; ++bin) {
    double count = 0.0, squares = 0.0, stated = 0.0, sums[5] = {};
    for (std::size_t k = 0; k < clips.size(); ++k) {
      const Clip& clip = clips[k];
      for (const auto& [id, e] : joint[k]) {
        if (!(e.distance > edges[bin]) || !(e.distance <= edges[bin + 1])) continue;
        const VehicleDetection* detection = nullptr;
        for (const VehicleDetection& d : clip.scene.find_frame(clip.middle)->vehicles) {
          if (d.id == id) detection = &d;
        }
        for (const TruthVehicle& t : truth_of(clip.scene, clip.middle).vehicles) {
          if (t.id != e.truth_id) continue;
          const Eigen::Vector3d foot = t.plane->foot(t.pose.bottom_center());
          const SupportPlane s = found_support(clip.three, clip.middle, *detection);
          const double off = s.plane.plane.signed_distance(foot);
          squares += off * off;
          stated += off * off / s.plane.height_variance(foot);
          if (bench.cars) {
            std::printf("    %s %2d %5.1f m: plane %+.3f +- %.3f, seen at %+.4f rad, %s\n",
                        clip.scene.name.c_str(), e.truth_id, e.distance, off,
                        std::sqrt(s.plane.height_variance(foot)),
                        -t.plane->normal.dot(t.pose.bottom_center().normalized()),
                        t.moving ? "moving" : "parked");
          }
        }
        const std::size_t clip_index = k;
        const int vehicle = id;
        const auto along = [&](const Errors& of) {
          return std::abs(of[clip_index].at(vehicle).along_error);
        };
        sums[0] += along(joint);
        sums[1] += along(alone);
        sums[2] += along(sure);
        sums[3] += 0.5 * (along(wrong[0]) + along(wrong[1]));
        sums[4] += 0.5 * (along(wrong[2]) + along(wrong[3]));
        count += 1.0;
      }
    }
    std::printf("| %s | %.0f | %.3f | %.2f | %.2f | %.2f | %.2f | %.2f | %.2f |\n", names[bin],
                count, std::sqrt(squares / count), std::sqrt(stated / count), sums[0] / count,
                sums[1] / count, sums[2] / count, sums[3] / count, sums[4] / count);
    table.row({names[bin], count, std::sqrt(squares / count), std::sqrt(stated / count),
               sums[0] / count, sums[1] / count, sums[2] / count, sums[3] / count,
               sums[4] / count});
  }
}

/// Four real cars with real network keypoints; the camera stands about 1.65 m above a flat road.
void real_keypoints(const Bench& bench, const fs::path& path) {
  std::ifstream in(path);
  const nlohmann::json json = nlohmann::json::parse(in);
  std::vector<double> errors, yaws;
  int inside = 0;
  VehicleFitOptions fit;
  fit.prior = bench.prior;
  bench::Items& items =
      bench.report.items("real", {bench::lower("centre", "m"), bench::lower("yaw, absolute", "deg"),
                                  bench::value("inside its 95 %")});
  for (const nlohmann::json& car : json.contains("cars") ? json["cars"] : json) {
    PinholeCamera camera;
    const auto& p = car["P2"];
    const auto at = [&](int r, int c) {
      return p.size() == 12 ? p[4 * r + c].get<double>() : p[r][c].get<double>();
    };
    camera = {1242, 375, at(0, 0), at(1, 1), at(0, 2), at(1, 2)};
    VehicleDetection detection;
    const auto& b = car["bbox_xyxy"];
    detection.box = {b[0], b[1], b[2], b[3]};
    for (const auto& k : car["keypoints_uv_confidence"]) {
      detection.keypoints.push_back({{k[0].get<double>(), k[1].get<double>()}});
    }
    const VehicleEstimate e = fit_vehicle(camera, detection, level_support(1.65, {}), fit);
    // The label is in the reference camera's frame; the left colour camera is shifted against it.
    const double tz = at(2, 3);
    const Eigen::Vector3d shift((at(0, 3) - camera.cx * tz) / camera.fx,
                                (at(1, 3) - camera.cy * tz) / camera.fy, tz);
    const auto& truth = car["ground_truth"];
    const auto& bottom = truth["bottom_center_camera"];
    const Eigen::Vector3d center = Eigen::Vector3d(bottom[0], bottom[1], bottom[2]) + shift -
                                   Eigen::Vector3d(0, 0.5 * truth["height"].get<double>(), 0);
    const Eigen::Vector3d difference = e.pose.center() - center;
    const double yaw = std::remainder(rotation_y(e.pose.camera_from_vehicle.rotation_matrix()) -
                                          truth["rotation_y"].get<double>(),
                                      2.0 * 3.14159265358979323846);
    errors.push_back(difference.norm());
    yaws.push_back(std::abs(yaw) * kDegrees);
    const Eigen::Matrix3d covariance = e.covariance.topLeftCorner<3, 3>();
    const double squared = difference.dot(covariance.inverse() * difference);
    inside += squared < 7.815 ? 1 : 0;
    items.add(
        car["sequence"].dump() + " " + car["frame"].dump() + " " + std::to_string(errors.size()),
        {errors.back(), yaws.back(), squared < 7.815 ? 1.0 : 0.0});
    if (bench.cars) {
      std::printf("    %s/%s %.1f m: error %.2f (%+.2f %+.2f %+.2f), yaw %+.1f, sigmas %.2f, %s\n",
                  car["sequence"].dump().c_str(), car["frame"].dump().c_str(), center.norm(),
                  difference.norm(), difference.x(), difference.y(), difference.z(), yaw * kDegrees,
                  std::sqrt(squared), std::string(to_string(e.status)).c_str());
    }
  }
  const ErrorSummary e = summarise(errors), y = summarise(yaws);
  std::printf(
      "centre error mean %.2f m, median %.2f m; yaw median %.1f deg; in their 95 %%: %d of "
      "%d\n",
      e.mean, e.median, y.median, inside, e.count);
  bench.report
      .table("real", "Real network keypoints on KITTI cars, camera 1.65 m above a flat road",
             "--only real",
             {bench::lower("centre, mean", "m"), bench::lower("centre, median", "m"),
              bench::lower("yaw, median", "deg"), bench::value("inside their 95 %"),
              bench::value("cars")})
      .row({e.mean, e.median, y.median, inside, e.count});
}

void run_steep_roads(bench::Report& report) {
  const std::string only = report.option("--only");
  const auto folder_of_seed = [&](const std::string& option) {
    const fs::path folder = report.option(option);
    return folder.empty() ? folder : folder / ("seed-" + std::to_string(report.seed()));
  };
  const fs::path keep = folder_of_seed("--keep");
  VehiclePrior prior = shipped_vehicle_prior();
  if (report.flag("--prior")) prior = read_vehicle_prior(report.option("--prior"));
  const Bench bench{report, &prior, report.flag("--cars")};
  const auto wanted = [&](const char* part) { return only.empty() || only == part; };
  const fs::path data = test::data_dir();
  std::printf("# Vehicles on steep roads\n\n");
  if (wanted("steep") || only == "budget") {
    if (fs::exists(data / "steep-scenes")) {
      const std::vector<Clip> clips = read_clips(data / "steep-scenes", report.seed(), keep);
      if (only == "budget") {
        budget(bench, clips);
      } else {
        steep_roads(bench, clips, "steep", "steep-scenes: vehicles by method");
      }
    } else {
      std::printf("skipped: no %s\n", (data / "steep-scenes").string().c_str());
    }
  }
  if (wanted("synth")) {
    std::printf("\n## Scenes of camber synth\n\n");
    const test::TemporaryFolder temporary;
    fs::path made = folder_of_seed("--made");
    if (made.empty()) made = keep.empty() ? temporary.path() : keep / "made";
    fs::create_directories(made);
    make_scenes(made, report.seed());
    steep_roads(bench, read_clips(made, report.seed(), keep), "synth",
                "Eight scenes of camber synth: vehicles by method");
  }
  if (wanted("real")) {
    std::printf("\n## Real network keypoints on KITTI cars, camera 1.65 m above a flat road\n\n");
    const fs::path real = data / "kitti-car-keypoints" / "cars.json";
    if (fs::exists(real)) {
      real_keypoints(bench, real);
    } else {
      std::printf("skipped: no %s\n", real.string().c_str());
    }
  }
}

}  // namespace
}  // namespace camber

int main(int argc, char** argv) {
  using namespace camber;
  const bench::Program program = {
      "bench_steep_roads",
      "Vehicles of steep roads by every method against their truth",
      {},
      {{"--keep", "DIR", "Store made scenes and found roads here and take them from here", false},
       {"--made", "DIR", "Store the made scenes here and take them from here", false},
       {"--cars", "", "List every vehicle", false},
       {"--prior", "FILE", "Shape prior in place of the shipped one"},
       {"--only", "PART", "steep, synth, real or budget", false}}};
  return bench::run_program(program, argc, argv, run_steep_roads);
}
