#include "pipeline/made_drive.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/pipeline/stages/road_layer.h"

namespace camber::test {
namespace {

constexpr double kRoad = 3.5, kWalls = 5.0, kFront = 45.0;  // m
constexpr int kStep = 4;                                    // px
constexpr double kPixelSigma = 0.05;                        // px, that the motion declares

/// Depth of what a pixel of the reference sees, and whether that is road (1) or pavement (2).
double depth_at(const PinholeCamera& camera, const SE3& world_from_reference,
                const MadeDriveOptions& options, const Eigen::Vector2d& pixel, int* label) {
  const Eigen::Vector3d ray = world_from_reference.rotation() * camera.ray(pixel);
  *label = 0;
  double depth = kFront / ray.z();
  if (ray.x() != 0.0) depth = std::min(depth, kWalls / std::abs(ray.x()));
  const double down = options.height / ray.y();
  if (down > 0.0 && down < depth) {
    depth = down;
    *label = std::abs(down * ray.x()) < kRoad ? 1 : 2;
  }
  return depth;
}

FrameMasks masks_of(const PinholeCamera& camera, const SE3& world_from_reference,
                    const MadeDriveOptions& options, bool shown,
                    const std::vector<VehicleDetection>& vehicles) {
  MaskInputs inputs;
  for (const VehicleDetection& v : vehicles) inputs.vehicle_boxes.push_back(v.box);
  if (shown) {
    Image labels{camera.width, camera.height, 1, {}};
    for (int v = 0; v < camera.height; ++v) {
      for (int u = 0; u < camera.width; ++u) {
        int label = 0;
        depth_at(camera, world_from_reference, options, Eigen::Vector2d(u, v), &label);
        labels.data.push_back(static_cast<std::uint8_t>(label));
      }
    }
    inputs.segmentation = std::move(labels);
    inputs.classes = {{1}, {2}, {}};
  }
  return make_frame_masks(camera, inputs);
}

LoadedFrames frames_of(const PinholeCamera& camera, const SE3& world_from_reference,
                       const MadeDriveOptions& options) {
  LoadedFrames out;
  out.camera = camera;
  out.reference = options.reference;
  out.known.camera_height = options.height;
  const auto pixels =
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  for (std::size_t k = 0; k < options.stations.size(); ++k) {
    SceneFrame frame;
    frame.id = static_cast<int>(k) + 10;
    if (!options.vehicles.empty()) frame.vehicles = options.vehicles[k];
    out.gray.push_back({camera.width, camera.height, std::vector<std::uint8_t>(pixels, 100)});
    out.color.push_back(
        {camera.width, camera.height, 3, std::vector<std::uint8_t>(3 * pixels, 100)});
    // Those of the others matter for images alone.
    out.masks.push_back(masks_of(camera, world_from_reference, options,
                                 options.masks && k == options.reference, frame.vehicles));
    out.frames.push_back(std::move(frame));
  }
  return out;
}

void add_matches(const std::vector<SE3>& frame_from_reference, MadeDrive* drive) {
  const PinholeCamera& camera = drive->frames.camera;
  Correspondences& m = drive->matches;
  for (std::size_t f = 0; f < frame_from_reference.size(); ++f) {
    if (f == drive->frames.reference) continue;
    MatchedImage match;
    match.frame = static_cast<int>(f);
    match.pixels.resize(m.pixels.size());
    match.round_trip_px.assign(m.pixels.size(), std::numeric_limits<float>::infinity());
    for (std::size_t i = 0; i < m.pixels.size(); ++i) {
      const Eigen::Vector3d x = drive->depths[i] * camera.ray(m.pixels[i].cast<double>());
      const auto p = camera.project(frame_from_reference[f] * x);
      if (!p || !camera.contains(*p)) continue;
      match.pixels[i] = p->cast<float>();
      match.round_trip_px[i] = 0.0f;
    }
    m.matches.push_back(std::move(match));
  }
}

}  // namespace

Eigen::Vector3d MadeDrive::travel() const { return travel_direction(motion, frames.reference); }

double MadeDrive::inverse_depth(const Eigen::Vector2d& pixel) const {
  return -plane.normal.dot(frames.camera.ray(pixel)) / plane.offset;
}

MadeDrive make_drive(const MadeDriveOptions& options) {
  MadeDrive out;
  const PinholeCamera camera{640, 240, 400.0, 400.0, 320.0, 90.0};
  // World: z along the road, y down, the reference camera above its origin.
  const auto looking = [&](double turn) {
    return rotation_from_vector(Eigen::Vector3d(-options.pitch, 0.0, 0.0)) *
           rotation_from_vector(Eigen::Vector3d(0.1 * turn, turn, 0.2 * turn));
  };
  const SE3 world_from_reference(looking(0.0), Eigen::Vector3d::Zero());
  out.frames = frames_of(camera, world_from_reference, options);
  out.plane = Plane{{0.0, -1.0, 0.0}, options.height}.transformed(world_from_reference.inverse());

  Correspondences& m = out.matches;
  m.reference = static_cast<int>(options.reference);
  m.step = kStep;
  m.columns = (camera.width - 1) / kStep + 1;
  m.rows = (camera.height - 1) / kStep + 1;
  for (int r = 0; r < m.rows; ++r) {
    for (int c = 0; c < m.columns; ++c) {
      m.pixels.emplace_back(static_cast<float>(c * kStep), static_cast<float>(r * kStep));
      m.texture.emplace_back(2000.0f, 0.0f, 2000.0f);
      int label = 0;
      out.depths.push_back(
          depth_at(camera, world_from_reference, options, m.pixels.back().cast<double>(), &label));
      out.is_ground.push_back(label != 0);
    }
  }
  std::vector<SE3> frame_from_reference;
  out.metres_per_baseline = 0.0;
  for (const double station : options.stations) {
    const SE3 world_from_camera(looking(0.01 * station), Eigen::Vector3d(0.0, 0.0, station));
    frame_from_reference.push_back(world_from_camera.inverse() * world_from_reference);
    out.metres_per_baseline = std::max(out.metres_per_baseline, std::abs(station));
  }
  frame_from_reference[options.reference] = SE3();
  add_matches(frame_from_reference, &out);

  out.motion.status = Status::kOk;
  out.motion.pixel_sigma = kPixelSigma;
  out.motion.points = 1000;
  out.motion.inlier_ratio = 1.0;
  for (SE3 pose : frame_from_reference) {
    pose.set_translation(pose.translation() / out.metres_per_baseline);
    out.motion.frame_from_reference.push_back(pose);
  }
  const auto parameters = 6 * static_cast<Eigen::Index>(options.stations.size() - 1);
  out.motion.covariance = 1e-10 * Eigen::MatrixXd::Identity(parameters, parameters);
  return out;
}

Ground exact_ground(const MadeDrive& drive) {
  const double m = drive.metres_per_baseline;
  Ground out;
  out.seen.is_ground = drive.is_ground;
  out.seen.is_roadway = drive.is_ground;
  TriangulatedPoints& points = out.seen.points;
  GroundObservations observed;
  for (std::size_t i = 0; i < drive.is_ground.size(); ++i) {
    if (!drive.is_ground[i]) continue;
    const Eigen::Vector2d pixel = drive.matches.pixels[i].cast<double>();
    points.grid.push_back(static_cast<int>(i));
    points.rays.push_back(drive.frames.camera.ray(pixel));
    points.inverse_depth.push_back(m / drive.depths[i]);
    points.sigma_own.push_back(0.002 * m / drive.depths[i]);
    observed.pixels.push_back(pixel);
  }
  const auto rows = static_cast<Eigen::Index>(points.size());
  points.pose_jacobian.setZero(rows, drive.motion.covariance.rows());
  observed.inverse_depth = points.inverse_depth;
  observed.sigma = points.sigma_own;
  observed.shared_jacobian = points.pose_jacobian;

  EgoPlane& ego = out.ego;
  ego.status = Status::kOk;
  ego.height = ego.near_plane_height = drive.plane.offset / m;
  ego.relative_sigma = 0.002;
  ego.metres_per_baseline = m;
  ego.points = static_cast<int>(rows);
  ego.plane.plane = {drive.plane.normal, ego.height};
  ego.plane.centroid = -ego.height * drive.plane.normal;
  UncertainPlane::make_axes(drive.plane.normal, drive.travel(), &ego.plane.axis1, &ego.plane.axis2);
  ego.plane.covariance = Eigen::Vector3d(4e-6, 4e-6, 4e-6 * ego.height * ego.height).asDiagonal();
  ego.shared_jacobian.setZero(3, drive.motion.covariance.rows());
  ego.line = {ego.plane.centroid, ego.plane.centroid + 10.0 * drive.travel()};

  out.metres_per_baseline = m;
  GroundFieldOptions field;
  field.metres_per_baseline = m;
  out.field = std::make_shared<GroundField>(drive.frames.camera, observed, ego.plane.plane, field);
  return out;
}

PhotometricGround exact_photometric(const MadeDrive& drive) {
  return {exact_ground(drive), drive.motion, nullptr, {}, "not run", {}};
}

ScaledRoad exact_scaled(const MadeDrive& drive, double log_scale_sigma) {
  const Ground ground = exact_ground(drive);
  return {RoadPosterior(ground.field, drive.motion.covariance, 4.0,
                        {ground.ego.plane, ground.ego.shared_jacobian}, drive.metres_per_baseline,
                        log_scale_sigma),
          true,
          {},
          {},
          {},
          {},
          0.0};
}

JudgedRoad judged_road(const LoadedFrames& frames, const Correspondences& matches,
                       const PhotometricGround& ground) {
  const ScaledRoad scaled = stages::scale(frames, matches, ground, {});
  const RoadLayer layer =
      stages::road_layer(frames, matches, ground, scaled.road.metres_per_baseline(), 0);
  return stages::judge(scaled, layer, {}, {});
}

PlaneSearchResult searched(double log_baseline, bool informative) {
  PlaneSearchResult out;
  out.best.log_baseline = log_baseline;
  out.correlation = 0.8;
  out.samples = 5000;
  out.informative = informative;
  return out;
}

const ConstraintReport* report_of(const std::vector<ConstraintReport>& reports,
                                  const std::string& name) {
  for (const ConstraintReport& report : reports) {
    if (report.name == name) return &report;
  }
  return nullptr;
}

void paint_markings(MadeDrive* drive) {
  constexpr int kSub = 4;  // samples a pixel, each way
  GrayImage& image = drive->frames.gray[drive->frames.reference];
  const SE3 level(rotation_from_vector({-0.05, 0.0, 0.0}), Eigen::Vector3d::Zero());
  for (int v = 0; v < image.height; ++v) {
    for (int u = 0; u < image.width; ++u) {
      int painted = 0;
      for (int s = 0; s < kSub * kSub; ++s) {
        const Eigen::Vector2d at(u + (s % kSub + 0.5) / kSub - 0.5,
                                 v + (s / kSub + 0.5) / kSub - 0.5);
        const double rho = drive->inverse_depth(at);
        if (!(rho > 1.0 / 44.0)) continue;
        const Eigen::Vector3d p = level * Eigen::Vector3d(drive->frames.camera.ray(at) / rho);
        const double x = p.x(), z = p.z();
        const bool stroke = std::abs(x + 1.0) < 0.06 && z > 5.0 && std::fmod(z - 5.0, 9.0) < 3.0;
        const bool stripe =
            z > 11.0 && z < 15.0 && x > -0.5 && x < 3.5 && std::fmod(x + 0.5, 1.0) < 0.5;
        painted += stroke || stripe;
      }
      image.pixels[static_cast<std::size_t>(v * image.width + u)] =
          static_cast<std::uint8_t>(90 + 110 * painted / (kSub * kSub));
    }
  }
}

}  // namespace camber::test
