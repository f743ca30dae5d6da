#include "camber/synth/detail/crop_scene.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "camber/core/threads.h"
#include "camber/synth/detail/mesh_builder.h"
#include "camber/synth/detail/plants.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846, kDegree = kPi / 180.0;
constexpr float kFlat = 3.4f;  ///< m around the car where the ground is level

float number(Sequence* random, double low, double high) {
  return static_cast<float>(random->uniform(low, high));
}

float log_number(Sequence* random, double low, double high) {
  return static_cast<float>(std::exp(random->uniform(std::log(low), std::log(high))));
}

CropMesh to_crop_mesh(const SynthMesh& mesh) {
  CropMesh out;
  for (const SynthTriangle& t : mesh.triangles) {
    const int first = static_cast<int>(out.vertices.size());
    for (const Eigen::Vector3d& p : t.points) out.vertices.push_back(p.cast<float>());
    out.triangles.emplace_back(first, first + 1, first + 2);
    out.normals.push_back(t.normals);
    out.materials.push_back(0);
  }
  return out;
}

/// world_from_mesh of a car on level ground (see CropScene) that heads along `heading`.
Eigen::Matrix3f car_rotation(float heading) {
  const float c = std::cos(heading), s = std::sin(heading);
  Eigen::Matrix3f out;
  out.col(0) = Eigen::Vector3f(c, s, 0);
  out.col(1) = Eigen::Vector3f(0, 0, 1);
  out.col(2) = Eigen::Vector3f(s, -c, 0);
  return out;
}

/// Draws one scene; the parts share what was drawn before them.
class SceneMaker {
 public:
  SceneMaker(const CropPool& pool, const CropCarTree& target, double end_on, Sequence* random)
      : pool_(pool),
        target_(target),
        end_on_(end_on),
        r_(random),
        scene_(std::make_unique<CropScene>(random)) {}

  std::unique_ptr<CropScene> make() {
    CropScene& s = *scene_;
    add(&target_.car.mesh, &target_.tree, car_rotation(0.0f), Eigen::Vector3f::Zero(),
        &target_.car);
    add(&s.things, nullptr, Eigen::Matrix3f::Identity(), Eigen::Vector3f::Zero(), nullptr);
    place_camera();
    s.textures.push_back(draw_ground_texture(r_));
    make_ground();
    const float tilt = r_->chance(0.3) ? number(r_, 0.0, 0.2) : number(r_, 0.0, 0.05);
    const float toward = number(r_, -kPi, kPi);
    s.environment.up =
        Eigen::Vector3f(tilt * std::cos(toward), tilt * std::sin(toward), 1.0f).normalized();
    if (r_->chance(0.7)) add_street();
    if (r_->chance(0.65)) add_neighbours();
    if (r_->chance(0.8)) add_walls();
    add_clutter();
    if (r_->chance(0.45)) add_occluder();
    s.things_tree = std::make_unique<MeshTree>(pool_.device, s.things, true);
    s.places[1].tree = s.things_tree.get();
    s.rays = std::make_unique<CropRays>(pool_.device, s.places);
    draw_box();
    draw_sensor();
    return std::move(scene_);
  }

 private:
  void add(const CropMesh* mesh, const MeshTree* tree, const Eigen::Matrix3f& rotation,
           const Eigen::Vector3f& origin, const CropCar* car, std::uint8_t leaves = 0) {
    CropScene& s = *scene_;
    s.places.push_back({mesh, tree, rotation, origin});
    s.cars.push_back(car);
    s.looks.push_back(car ? draw_crop_car_look(*car, r_) : CropCarLook{});
    s.leaves.push_back(leaves);
  }

  std::uint8_t add_texture(const CropTexture& texture) {
    scene_->textures.push_back(texture);
    return static_cast<std::uint8_t>(scene_->textures.size() - 1);
  }

  /// Height of the ground at a place: level around the car, then inclined, so that the camera is at
  /// a usual height above it where that can be.
  float ground_at(float x, float y) const {
    const float away = std::hypot(x, y);
    if (away <= kFlat) return 0.0f;
    const float cosine = (x * toward_.x() + y * toward_.y()) / away;
    const float sine = (-x * toward_.y() + y * toward_.x()) / away;
    return (away - kFlat) * (cosine > 0.0f ? cosine * slope_near_ : -cosine * slope_far_) +
           (away - kFlat) * std::fabs(sine) * (sine > 0.0f ? slope_left_ : slope_right_);
  }

  void place_camera() {
    for (int attempt = 0;; ++attempt) {
      draw_pose();
      if (draw_view() || attempt == 40) break;
    }
    draw_slopes();
  }

  /// Where the camera is, seen from the car.
  void draw_pose() {
    CropScene& s = *scene_;
    // Cars are seen along the street more often than across it.
    double azimuth = r_->uniform(0.0, 2.0 * kPi);
    if (r_->chance(0.4)) {
      azimuth = (r_->chance(0.6) ? 0.5 : 1.5) * kPi + 25.0 * kDegree * r_->normal();
    }
    if (end_on_ > 0.0 && r_->chance(end_on_)) {
      azimuth = (r_->chance(0.6) ? 0.5 : 1.5) * kPi + 8.0 * kDegree * r_->normal();
    }
    azimuth = std::fmod(azimuth + 4.0 * kPi, 2.0 * kPi);
    const float distance = log_number(r_, 4.0, 60.0);
    double elevation;
    if (r_->chance(0.6)) {
      elevation = std::atan((r_->uniform(1.0, 2.3) - 0.7) / static_cast<double>(distance)) +
                  2.5 * kDegree * r_->normal();
    } else if (r_->chance(0.6)) {
      elevation = r_->uniform(-1.0, 8.0) * kDegree;
    } else {
      elevation = r_->uniform(4.0, 25.0) * kDegree;
    }
    elevation = std::clamp(elevation, -3.0 * kDegree, 25.0 * kDegree);
    s.azimuth = static_cast<float>(azimuth);
    s.elevation = static_cast<float>(elevation);
    s.distance = distance;
    // Azimuth 0 is seen from the right, 90 degrees from behind: in the car's frame the camera is
    // towards (-sin, ., cos).
    const Eigen::Vector3f flat =
        car_rotation(0.0f) * Eigen::Vector3f(-std::sin(s.azimuth), 0.0f, std::cos(s.azimuth));
    toward_ = flat.head<2>();
    s.camera.eye = middle() + distance * (std::cos(s.elevation) * flat +
                                          std::sin(s.elevation) * Eigen::Vector3f::UnitZ());
  }

  static Eigen::Vector3f middle() { return {0.0f, 0.0f, 0.7f}; }

  /// The camera's orientation and lens. @return whether enough of the car is in the image.
  bool draw_view() {
    CropScene& s = *scene_;
    constexpr int kSizes[][2] = {{1242, 375},  {1242, 375}, {1280, 720}, {960, 540},
                                 {1920, 1080}, {640, 480},  {1280, 960}, {1024, 768}};
    const auto& size = kSizes[r_->below(8)];
    CropCamera& c = s.camera;
    c.width = size[0];
    c.height = size[1];
    const double view = r_->uniform(40.0, 100.0) * kDegree;
    c.focal = static_cast<float>(0.5 * c.width / std::tan(0.5 * view));
    c.cx = 0.5f * static_cast<float>(c.width) + number(r_, -15.0, 15.0);
    c.cy = number(r_, 0.44, 0.56) * static_cast<float>(c.height);
    const Eigen::Vector2f pixel(number(r_, -0.02, 1.02) * static_cast<float>(c.width),
                                c.cy + number(r_, -0.12, 0.30) * static_cast<float>(c.height));
    const Eigen::Vector3f forward = (middle() - c.eye).normalized();
    const Eigen::Vector3f right = forward.cross(Eigen::Vector3f::UnitZ()).normalized();
    Eigen::Matrix3f looking;
    looking << right, forward.cross(right), forward;
    const Eigen::Vector3f ray =
        Eigen::Vector3f((pixel.x() - c.cx) / c.focal, (pixel.y() - c.cy) / c.focal, 1.0f)
            .normalized();
    const float roll = (r_->chance(0.25) ? 0.10f : 0.025f) * static_cast<float>(r_->normal());
    c.world_from_camera =
        looking * Eigen::AngleAxisf(roll, Eigen::Vector3f::UnitZ()).toRotationMatrix() *
        Eigen::Quaternionf::FromTwoVectors(ray, Eigen::Vector3f::UnitZ()).toRotationMatrix();
    Box2& box = s.true_box;
    box = {1e9, 1e9, -1e9, -1e9};
    for (const Eigen::Vector3d& vertex : target_.car.model.mesh.vertices) {
      const Eigen::Vector3f p = c.project(car_rotation(0.0f) * vertex.cast<float>());
      if (p.z() < 0.3f) return false;
      box.x1 = std::min(box.x1, static_cast<double>(p.x()));
      box.y1 = std::min(box.y1, static_cast<double>(p.y()));
      box.x2 = std::max(box.x2, static_cast<double>(p.x()));
      box.y2 = std::max(box.y2, static_cast<double>(p.y()));
    }
    const double inside = box.clipped(c.width, c.height).area() / box.area();
    return box.height() >= 16.0 && inside > r_->uniform(0.45, 1.0);
  }

  void draw_slopes() {
    const float eye = scene_->camera.eye.z();
    const float reach = std::max(0.5f, scene_->camera.eye.head<2>().norm() - kFlat);
    const float height = number(r_, 1.1, 2.3);
    slope_near_ = std::clamp((eye - height) / reach, -0.3f, 0.3f);
    slope_near_ = std::min(slope_near_, 0.9f * eye / reach);
    slope_far_ = r_->chance(0.5) ? number(r_, -0.12, 0.12) : -slope_near_;
    slope_left_ = r_->chance(0.3) ? number(r_, -0.15, 0.15) : 0.0f;
    slope_right_ = r_->chance(0.3) ? number(r_, -0.15, 0.15) : 0.0f;
  }

  /// The detector's box: the part in the image, off by a share of its size.
  void draw_box() {
    CropScene& s = *scene_;
    Box2 clipped = s.true_box.clipped(s.camera.width, s.camera.height);
    if (r_->chance(0.3)) clipped = visible_part(clipped);
    const double spread = r_->chance(0.15) ? 0.07 : 0.025;
    const auto jitter = [&](double size) {
      return spread * size * std::clamp(r_->normal(), -2.5, 2.5);
    };
    const double w = clipped.width(), h = clipped.height();
    s.box = {clipped.x1 + jitter(w), clipped.y1 + jitter(h), clipped.x2 + jitter(w),
             clipped.y2 + jitter(h)};
  }

  /// The extent of what is seen of the car in a box: some detectors give that.
  Box2 visible_part(const Box2& box) const {
    constexpr int kGrid = 32;
    std::vector<Eigen::Vector3f> directions;
    std::vector<Eigen::Vector2d> pixels;
    for (int i = 0; i < kGrid * kGrid; ++i) {
      pixels.emplace_back(box.x1 + box.width() * (i % kGrid + 0.5) / kGrid,
                          box.y1 + box.height() * (i / kGrid + 0.5) / kGrid);
      directions.push_back(scene_->camera.ray(pixels.back().cast<float>()));
    }
    std::vector<CropRays::Hit> hits(directions.size());
    scene_->rays->nearest(&scene_->camera.eye, false, directions.data(), hits.size(), hits.data());
    Box2 out{1e9, 1e9, -1e9, -1e9};
    const double half_x = 0.5 * box.width() / kGrid, half_y = 0.5 * box.height() / kGrid;
    for (std::size_t i = 0; i < hits.size(); ++i) {
      if (hits[i].place != 0) continue;
      out.x1 = std::min(out.x1, pixels[i].x() - half_x);
      out.y1 = std::min(out.y1, pixels[i].y() - half_y);
      out.x2 = std::max(out.x2, pixels[i].x() + half_x);
      out.y2 = std::max(out.y2, pixels[i].y() + half_y);
    }
    return out.width() > 0.3 * box.width() && out.height() > 0.3 * box.height() ? out : box;
  }

  void make_ground() {
    constexpr int kSectors = 28;
    constexpr float kRings[] = {0.0f, kFlat, 8.0f, 20.0f, 60.0f, 250.0f};
    auto point = [&](int ring, int sector) {
      const float angle = static_cast<float>(2.0 * kPi * sector / kSectors);
      const float x = kRings[ring] * std::cos(angle), y = kRings[ring] * std::sin(angle);
      return Eigen::Vector3f(x, y, ground_at(x, y));
    };
    for (int ring = 0; ring < 5; ++ring) {
      for (int i = 0; i < kSectors; ++i) {
        scene_->things.add_quad(
            {point(ring, i), point(ring + 1, i), point(ring + 1, i + 1), point(ring, i + 1)}, 0);
      }
    }
  }

  /// A strip on the ground along the car's street, `lift` above it: lines, pavements, verges.
  void add_strip(float y0, float y1, float x0, float x1, float lift, std::uint8_t material) {
    const int pieces = std::max(1, static_cast<int>((x1 - x0) / 4.0f));
    for (int i = 0; i < pieces; ++i) {
      const float a = x0 + (x1 - x0) * static_cast<float>(i) / static_cast<float>(pieces);
      const float b = x0 + (x1 - x0) * static_cast<float>(i + 1) / static_cast<float>(pieces);
      const auto at = [&](float x, float y, float up) {
        return Eigen::Vector3f(x, y, ground_at(x, y) + up);
      };
      scene_->things.add_quad({at(a, y0, lift), at(b, y0, lift), at(b, y1, lift), at(a, y1, lift)},
                              material);
      if (lift > 0.03f) {
        scene_->things.add_quad({at(a, y0, 0), at(b, y0, 0), at(b, y0, lift), at(a, y0, lift)},
                                material);
        scene_->things.add_quad({at(b, y1, 0), at(a, y1, 0), at(a, y1, lift), at(b, y1, lift)},
                                material);
      }
    }
  }

  /// Pavements or verges beside the car and painted lines.
  void add_street() {
    const float half = 0.5f * static_cast<float>(target_.car.model.dimensions.width);
    for (const float side : {-1.0f, 1.0f}) {
      if (!r_->chance(0.5)) continue;
      const std::uint8_t material = add_texture(draw_ground_texture(r_));
      const float near = half + number(r_, 0.25, 4.0);
      const float far = near + number(r_, 1.0, 12.0);
      const float lift = r_->chance(0.7) ? number(r_, 0.04, 0.16) : 0.012f;
      add_strip(side > 0 ? near : -far, side > 0 ? far : -near, -40.0f, 40.0f, lift, material);
    }
    if (r_->chance(0.5)) {
      CropTexture line;
      line.a = Color::Constant(number(r_, 0.35, 0.8));
      const std::uint8_t material = add_texture(line);
      const float y = static_cast<float>(r_->sign()) * number(r_, half + 0.2, 3.2);
      const bool solid = r_->chance(0.5);
      for (float x = -30.0f; x < 30.0f; x += solid ? 4.0f : 7.0f) {
        add_strip(y - 0.07f, y + 0.07f, x, x + (solid ? 4.0f : 3.0f), 0.008f, material);
      }
    }
  }

  /// Whether a thing of a radius may stand at a place: not in the car, not on the camera.
  bool is_free(float x, float y, float radius) const {
    const float half_length = 0.5f * static_cast<float>(target_.car.model.dimensions.length);
    const float half_width = 0.5f * static_cast<float>(target_.car.model.dimensions.width);
    if (std::fabs(x) < half_length + radius && std::fabs(y) < half_width + radius) return false;
    return (scene_->camera.eye.head<2>() - Eigen::Vector2f(x, y)).norm() > radius + 1.2f;
  }

  /// Distance of a place from the line of sight to the car's middle, m; beyond the car: infinite.
  float off_sight(float x, float y) const {
    const float along = x * toward_.x() + y * toward_.y();
    return along < 0.0f ? 1e9f : std::fabs(-x * toward_.y() + y * toward_.x());
  }

  void add_car(float x, float y, float heading) {
    const CropCarTree& other = *pool_.cars[r_->below(static_cast<int>(pool_.cars.size()))];
    add(&other.car.mesh, &other.tree, car_rotation(heading), Eigen::Vector3f(x, y, ground_at(x, y)),
        &other.car);
  }

  /// Cars parked before, behind or beside this one, and others on the road.
  void add_neighbours() {
    const bool row = r_->chance(0.5);
    for (const float side : {-1.0f, 1.0f}) {
      if (!r_->chance(0.6)) continue;
      float x = row ? side * number(r_, 4.9, 6.5) : number(r_, -0.6, 0.6);
      float y = row ? number(r_, -0.25, 0.25) : side * number(r_, 2.3, 3.4);
      const float heading =
          number(r_, -0.06, 0.06) + (r_->chance(0.2) ? static_cast<float>(kPi) : 0.0f);
      if (is_free(x, y, 1.9f) || !row) {
        if ((scene_->camera.eye.head<2>() - Eigen::Vector2f(x, y)).norm() > 3.2f) {
          add_car(x, y, heading);
        }
      }
    }
    const int others = r_->below(4);
    for (int i = 0; i < others; ++i) {
      const float x = number(r_, -25.0, 25.0), y = number(r_, -14.0, 14.0);
      const float heading = r_->chance(0.6) ? (r_->chance(0.5) ? 0.0f : static_cast<float>(kPi))
                                            : number(r_, -kPi, kPi);
      if (std::hypot(x, y) < 5.2f || !is_free(x, y, 3.0f) || off_sight(x, y) < 3.0f) continue;
      add_car(x, y, heading);
    }
  }

  void add_walls() {
    const float eye_x = scene_->camera.eye.x(), eye_y = scene_->camera.eye.y();
    for (int side = 0; side < 4; ++side) {
      if (!r_->chance(side < 2 ? 0.55 : 0.3)) continue;
      const bool across = side >= 2;
      const float sign = side % 2 ? 1.0f : -1.0f;
      const float place = across ? number(r_, 6.0, 40.0) : log_number(r_, 2.6, 25.0);
      if (sign * (across ? eye_x : eye_y) > place - 1.0f) continue;
      const std::uint8_t material = add_texture(draw_wall_texture(r_));
      const float height = log_number(r_, 0.7, 12.0);
      float from = -60.0f;
      while (from < 60.0f) {  // houses or pieces of wall with gaps
        const float to = from + log_number(r_, 3.0, 80.0);
        const float set_back = number(r_, 0.0, 2.0);
        const float d = sign * (place + set_back);
        const Eigen::Vector3f foot = across ? Eigen::Vector3f(d, 0.5f * (from + to), 0.0f)
                                            : Eigen::Vector3f(0.5f * (from + to), d, 0.0f);
        const float base = ground_at(foot.x(), foot.y()) - 3.0f;
        const float half = 0.5f * (to - from), high = 0.5f * (height + 3.0f);
        const Eigen::Vector3f sizes =
            across ? Eigen::Vector3f(0.15f, half, high) : Eigen::Vector3f(half, 0.15f, high);
        const bool fresh = r_->chance(0.4);
        scene_->things.add_box(
            foot + Eigen::Vector3f(0, 0, base + high), Eigen::Matrix3f::Identity(), sizes,
            fresh && scene_->textures.size() < 60 ? add_texture(draw_wall_texture(r_)) : material);
        from = to + (r_->chance(0.5) ? number(r_, 0.5, 8.0) : 0.0f);
      }
    }
  }

  void add_plant(float x, float y, float size, bool tree) {
    const auto& plants = tree ? pool_.trees : pool_.bushes;
    const CropPlant& plant = *plants[r_->below(static_cast<int>(plants.size()))];
    const std::uint8_t leaves = add_texture(draw_leaf_texture(r_));
    add(&plant.mesh, &plant.tree,
        size *
            Eigen::AngleAxisf(number(r_, -kPi, kPi), Eigen::Vector3f::UnitZ()).toRotationMatrix(),
        Eigen::Vector3f(x, y, ground_at(x, y)), nullptr, leaves);
  }

  void add_pole(float x, float y) {
    CropTexture texture;
    texture.a = Color::Constant(log_number(r_, 0.02, 0.6));
    if (r_->chance(0.3)) {
      texture.kind = CropTexture::Kind::kStripes;
      texture.b = Color(number(r_, 0.0, 0.6), number(r_, 0.0, 0.2), 0.02f);
      texture.scale = number(r_, 0.2, 0.6);
      texture.contrast = 0.0785f;  // level bands
    }
    const float height = r_->chance(0.3) ? number(r_, 0.6, 1.3) : number(r_, 2.0, 7.0);
    const float radius = log_number(r_, 0.025, 0.2);
    const Eigen::Vector3f foot(x, y, ground_at(x, y) - 0.2f);
    scene_->things.add_post(foot, foot + Eigen::Vector3f(0, 0, height), radius, radius, 10,
                            add_texture(texture));
    if (height > 2.0f && r_->chance(0.4)) {
      scene_->things.add_box(
          foot + Eigen::Vector3f(0, 0, height), car_rotation(number(r_, -kPi, kPi)),
          {number(r_, 0.2, 0.5), number(r_, 0.2, 0.5), 0.02f}, add_texture(draw_wall_texture(r_)));
    }
  }

  void add_block(float x, float y) {
    const Eigen::Vector3f half(number(r_, 0.15, 0.9), number(r_, 0.15, 0.9), number(r_, 0.2, 0.8));
    const float base = ground_at(x, y) + half.z() - 0.1f;
    const Eigen::Matrix3f axes =
        Eigen::AngleAxisf(number(r_, -kPi, kPi), Eigen::Vector3f::UnitZ()).toRotationMatrix();
    scene_->things.add_box({x, y, base}, axes, half, add_texture(draw_wall_texture(r_)));
  }

  /// Poles, plants and boxes around the car, behind it more than before it.
  void add_clutter() {
    const int count = r_->below(12);
    for (int i = 0; i < count; ++i) {
      // Rather behind the car, where the crop shows it.
      Eigen::Vector2f place(number(r_, -14.0, 14.0), number(r_, -12.0, 12.0));
      if (r_->chance(0.6)) {
        const float away = number(r_, 3.0, 22.0), aside = number(r_, -0.35, 0.35) * away;
        place = -away * toward_ + aside * Eigen::Vector2f(-toward_.y(), toward_.x());
      }
      const float x = place.x(), y = place.y();
      const double kind = r_->uniform(0.0, 1.0);
      if (!is_free(x, y, 1.3f) || (off_sight(x, y) < 2.8f && !r_->chance(0.15))) continue;
      if (kind < 0.35) {
        add_pole(x, y);
      } else if (kind < 0.55) {
        add_plant(x, y, number(r_, 0.6, 1.2), true);
      } else if (kind < 0.8) {
        add_plant(x, y, number(r_, 0.5, 1.6), false);
      } else {
        add_block(x, y);
      }
    }
  }

  /// Something between the camera and the car that hides a part of it.
  void add_occluder() {
    const float reach = scene_->camera.eye.head<2>().norm();
    const double kind = r_->uniform(0.0, 1.0);
    const bool car = kind < 0.5;
    const float nearest = car ? 4.6f : 2.6f;
    const float farthest = std::min(reach - (car ? 3.2f : 1.5f), 16.0f);
    if (farthest <= nearest) return;
    const float along = number(r_, nearest, farthest);
    // The car is seen about two metres to each side of the line of sight.
    const float shrink = 1.0f - along / reach;
    const float edge = 2.2f * shrink;
    float off = car ? static_cast<float>(r_->sign()) * (edge + number(r_, -0.5, 1.4))
                    : number(r_, -1.0, 1.0) * edge;
    const float x = along * toward_.x() - off * toward_.y();
    const float y = along * toward_.y() + off * toward_.x();
    if (!is_free(x, y, car ? 2.2f : 0.8f)) return;
    if (car) {
      const float heading = r_->chance(0.6) ? number(r_, -0.1, 0.1) +
                                                  (r_->chance(0.3) ? static_cast<float>(kPi) : 0.0f)
                                            : number(r_, -kPi, kPi);
      add_car(x, y, heading);
    } else if (kind < 0.72) {
      add_pole(x, y);
    } else if (kind < 0.88) {
      add_plant(x, y, number(r_, 0.3, 0.9), false);
    } else {
      add_block(x, y);
    }
  }

  void draw_sensor() {
    CropSensor& s = scene_->sensor;
    // Not beyond what leaves the car recognisable.
    const float size = static_cast<float>(scene_->true_box.height());
    s.blur = r_->chance(0.15) ? number(r_, 0.8, 2.5) : number(r_, 0.25, 0.8);
    s.blur = std::min(s.blur, std::max(0.45f, 0.03f * size));
    if (r_->chance(0.12)) {
      s.motion = std::min(number(r_, 1.0, 6.0), 0.08f * size);
      s.motion_angle = r_->chance(0.7) ? number(r_, -0.2, 0.2) : number(r_, -kPi, kPi);
    }
    s.brightness = log_number(r_, 0.07, 0.5);
    s.darkest = log_number(r_, 0.015, 0.06);
    s.gamma = number(r_, 1.3, 2.5);
    s.contrast = number(r_, -0.15, 1.2);
    for (int c = 0; c < 3; ++c) s.gains[c] = std::exp(0.08f * static_cast<float>(r_->normal()));
    s.saturation = r_->chance(0.05) ? 0.0f : number(r_, 0.6, 2.0);
    s.noise = log_number(r_, 0.4, 7.0);
    s.shot = r_->chance(0.5) ? number(r_, 0.0, 5.0) : 0.0f;
    s.mosaic = r_->chance(0.4);
    s.jpeg = r_->chance(0.4) ? 30 + r_->below(66) : 0;
    s.seed = r_->bits();
  }

  const CropPool& pool_;
  const CropCarTree& target_;
  double end_on_;
  Sequence* r_;
  std::unique_ptr<CropScene> scene_;
  Eigen::Vector2f toward_{1, 0};  ///< from the car to the camera, in plan, unit
  float slope_near_ = 0, slope_far_ = 0, slope_left_ = 0, slope_right_ = 0;
};

}  // namespace

CropPool make_crop_pool(const CounterRandom& random, int num_threads) {
  constexpr std::size_t kCars = 64, kBushes = 8, kTrees = 8;
  CropPool pool;
  pool.device = embree::new_device();
  pool.cars.resize(kCars);
  pool.bushes.resize(kBushes);
  pool.trees.resize(kTrees);
  parallel_for(kCars + kBushes + kTrees, num_threads, [&](std::size_t i) {
    if (i < kCars) {
      pool.cars[i] = std::make_unique<CropCarTree>(pool.device, draw_crop_car(random, i));
      return;
    }
    SynthMesh mesh;
    MeshBuilder builder(&mesh);
    const auto seed = static_cast<std::uint32_t>(random.bits(i));
    const bool bush = i < kCars + kBushes;
    if (bush) {
      plant_bush(Eigen::Vector3d::Zero(), 1.0, false, seed, &builder);
      pool.bushes[i - kCars] = std::make_unique<CropPlant>(pool.device, to_crop_mesh(mesh));
    } else {
      plant_tree(Eigen::Vector3d::Zero(), 1.0, false, seed, &builder);
      pool.trees[i - kCars - kBushes] =
          std::make_unique<CropPlant>(pool.device, to_crop_mesh(mesh));
    }
  });
  return pool;
}

std::array<Eigen::Vector3f, kNumKeypoints> CropScene::keypoints() const {
  std::array<Eigen::Vector3f, kNumKeypoints> out;
  for (int k = 0; k < kNumKeypoints; ++k) {
    out[k] = places[0].rotation * cars[0]->model.keypoints[k].cast<float>() + places[0].origin;
  }
  return out;
}

std::unique_ptr<CropScene> draw_crop_scene(const CropPool& pool, const CropCarTree& target,
                                           double end_on, Sequence* random) {
  return SceneMaker(pool, target, end_on, random).make();
}

}  // namespace camber
