#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "camber/synth/detail/surface.h"
#include "camber/synth/synth_world.h"

namespace camber {

/// Viewing rays of neighbouring samples, world frame.
struct SampleRays {
  std::vector<Eigen::Vector3d> origins;               ///< one, or one a ray
  std::vector<Eigen::Vector3d> directions;            ///< any length
  std::vector<std::uint32_t> random;                  ///< hash of the sample, for soft shadows
  Eigen::Vector3d along_x = Eigen::Vector3d::Zero();  ///< change of the direction to the right
  Eigen::Vector3d along_y = Eigen::Vector3d::Zero();  ///< change to the sample below

  std::size_t size() const { return directions.size(); }
  const Eigen::Vector3d& origin(std::size_t i) const { return origins[origins.size() > 1 ? i : 0]; }
};

/// Light that comes back along rays, in one frame of a scene. Textures are functions of place,
/// averaged over the sample's footprint: octaves of noise finer than the footprint are left out,
/// and up to 16 places along its long side are taken. Wet asphalt mirrors what its reflected rays
/// meet. Any number of threads may shade.
class Shader {
 public:
  /// The world must outlive it.
  Shader(const SynthWorld& world, int frame);
  /// Linear light of each ray; best some hundred rays at a time.
  void shade(const SampleRays& rays, Color* light) const;

 private:
  struct Facet;
  struct Point;
  struct CarPose {
    Eigen::Matrix3d world_from_vehicle;
    Eigen::Vector3d place;
    double half_length, half_width;
  };

  void shade(const SampleRays& rays, bool reflections, Color* light) const;
  void set_facet(const SampleRays& rays, std::size_t index, const WorldHit& hit,
                 Facet* facet) const;
  bool locate(const SampleRays& rays, std::size_t index, const Facet& facet, Point* point) const;
  void set_surfaces(std::vector<Point>* points) const;
  void wet(Point* point) const;
  void cast_shadows(const SampleRays& rays, std::vector<Point>* points) const;
  float openness(const Eigen::Vector3d& position) const;
  Color lit(const Point& point) const;
  void add_reflections(const SampleRays& rays, const std::vector<Point>& points,
                       Color* light) const;

  const SynthWorld& world_;
  int frame_;
  std::vector<CarPose> cars_;
  Eigen::Vector3d sun_across_, sun_down_;  ///< directions square to the sun's
};

}  // namespace camber
