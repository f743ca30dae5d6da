#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "camber/geometry/box.h"
#include "camber/synth/detail/crop_car.h"
#include "camber/synth/detail/crop_environment.h"
#include "camber/synth/detail/crop_rays.h"

namespace camber {

/// A car with its tree.
struct CropCarTree {
  CropCarTree(const embree::Device& device, CropCar built)
      : car(std::move(built)), tree(device, car.mesh, true) {}
  CropCar car;
  MeshTree tree;
};

/// A plant with its tree, on the origin of z up.
struct CropPlant {
  CropPlant(const embree::Device& device, CropMesh built)
      : mesh(std::move(built)), tree(device, mesh, true) {}
  CropMesh mesh;
  MeshTree tree;
};

/// What all crops share: other cars and plants, made once.
struct CropPool {
  embree::Device device;
  std::vector<std::unique_ptr<CropCarTree>> cars;
  std::vector<std::unique_ptr<CropPlant>> bushes, trees;
};

/// @param random  of the cars of a split
CropPool make_crop_pool(const CounterRandom& random, int num_threads);

/// The camera of a crop's image: no distortion, pixel centres at whole numbers.
struct CropCamera {
  int width = 0, height = 0;  ///< px
  float focal = 1.0f, cx = 0.0f, cy = 0.0f;
  Eigen::Matrix3f world_from_camera = Eigen::Matrix3f::Identity();
  Eigen::Vector3f eye = Eigen::Vector3f::Zero();  ///< world

  Eigen::Vector3f ray(const Eigen::Vector2f& pixel) const {  ///< world, depth 1
    return world_from_camera *
           Eigen::Vector3f((pixel.x() - cx) / focal, (pixel.y() - cy) / focal, 1.0f);
  }
  /// Pixel and depth of a point of the world; the pixel is meaningless for depths <= 0.
  Eigen::Vector3f project(const Eigen::Vector3f& p) const {
    const Eigen::Vector3f c = world_from_camera.transpose() * (p - eye);
    return {focal * c.x() / c.z() + cx, focal * c.y() / c.z() + cy, c.z()};
  }
};

/// What the camera's optics, sensor and files do to a crop's light.
struct CropSensor {
  float blur = 0.5f;                         ///< standard deviation, px of the image
  float motion = 0.0f, motion_angle = 0.0f;  ///< length, px of the image; rad
  float brightness = 0.2f;                   ///< mean light is brought to this, 1: white
  float darkest = 0.02f;                     ///< mean light of the car at least, likewise
  float gamma = 2.2f, contrast = 0.0f;       ///< of the response; S-shaped part
  Color gains = Color::Ones();
  float saturation = 1.0f;
  float noise = 1.5f, shot = 0.0f;  ///< grey levels; extra at full light
  bool mosaic = false;              ///< one colour a pixel, interpolated
  int jpeg = 0;                     ///< quality; 0: none
  std::uint64_t seed = 0;
};

/// World: z up, origin on the ground in the middle below the crop's car, x along the car.
struct CropScene {
  explicit CropScene(Sequence* random) : environment(random) {}

  CropEnvironment environment;
  std::vector<MeshPlace> places;     ///< 0 the crop's car, 1 ground and things
  std::vector<const CropCar*> cars;  ///< a place; null: no car
  std::vector<CropCarLook> looks;    ///< a place
  std::vector<std::uint8_t> leaves;  ///< a place; its texture where it is a plant
  CropMesh things;                   ///< ground, walls, posts; materials index textures
  std::unique_ptr<MeshTree> things_tree;
  std::unique_ptr<CropRays> rays;
  std::vector<CropTexture> textures;
  CropCamera camera;
  CropSensor sensor;
  Box2 true_box, box;  ///< of the whole car, px; as a detector gives it
  float azimuth = 0.0f, elevation = 0.0f, distance = 0.0f;

  std::array<Eigen::Vector3f, kNumKeypoints> keypoints() const;  ///< world
};

/// @param target  outlives the scene, as the pool does
/// @param end_on  probability of a view of the front or rear, KeypointCropOptions::end_on
std::unique_ptr<CropScene> draw_crop_scene(const CropPool& pool, const CropCarTree& target,
                                           double end_on, Sequence* random);

/// Light of the rays of view from the camera.
class CropShader {
 public:
  /// @param pixel  angle between neighbouring samples, rad
  CropShader(const CropScene& scene, float pixel) : scene_(scene), pixel_(pixel) {}
  /// @param random  a hash for each sample
  void shade(const std::vector<Eigen::Vector3f>& directions,
             const std::vector<std::uint32_t>& random, Color* light) const;

 private:
  struct Point;
  bool locate(const CropRays::Hit& hit, const Eigen::Vector3f& origin,
              const Eigen::Vector3f& direction, Point* point) const;
  void cast_shadows(const std::vector<std::uint32_t>& random, std::vector<Point>* points) const;
  float openness(const Eigen::Vector3f& position) const;
  Color lit(const Point& point) const;
  void see_through(const std::vector<Point>& points, Color* light) const;

  const CropScene& scene_;
  float pixel_;
};

}  // namespace camber
