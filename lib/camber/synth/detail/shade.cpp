#include "camber/synth/detail/shade.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "camber/synth/detail/car_textures.h"
#include "camber/synth/detail/ground_textures.h"
#include "camber/synth/detail/ray_caster.h"
#include "camber/synth/detail/sky.h"
#include "camber/synth/detail/wall_textures.h"

namespace camber {

namespace {

constexpr float kPi = 3.14159265f;

/// Share of light that a water surface mirrors (Schlick, "An Inexpensive BRDF Model for
/// Physically-based Rendering", 1994).
float water_fresnel(float cosine) {
  const float grazing = 1.0f - std::clamp(cosine, 0.0f, 1.0f);
  const float square = grazing * grazing;
  return 0.02f + 0.98f * square * square * grazing;
}

bool is_ground(SurfaceKind kind) {
  return kind == SurfaceKind::kAsphalt || kind == SurfaceKind::kKerb ||
         kind == SurfaceKind::kPavement || kind == SurfaceKind::kPad || kind == SurfaceKind::kGrass;
}

/// Places on one object and its reflectance there.
struct TexelBatch {
  std::vector<float> u, v, width, red, green, blue, mirror;

  void clear() {
    u.clear();
    v.clear();
    width.clear();
  }
  void add(float at_u, float at_v, float pixel) {
    u.push_back(at_u);
    v.push_back(at_v);
    width.push_back(pixel);
  }

  void evaluate(const SynthWorld& world, const SynthObject& object) {
    const std::size_t count = u.size();
    for (auto* values : {&red, &green, &blue, &mirror}) values->assign(count, 0.0f);
    for (std::size_t first = 0; first < count; first += TexelChunk::kMost) {
      TexelChunk c;
      c.n = static_cast<int>(std::min<std::size_t>(TexelChunk::kMost, count - first));
      c.u = u.data() + first;
      c.v = v.data() + first;
      c.width = width.data() + first;
      c.narrowest = *std::min_element(c.width, c.width + c.n);
      float* const out[3] = {red.data() + first, green.data() + first, blue.data() + first};
      if (is_ground(object.kind)) {
        ground_reflectance(world, object, c, out);
      } else {
        wall_reflectance(object, c, out, mirror.data() + first);
      }
    }
  }
};

}  // namespace

/// What all rays that meet one triangle share, in the mesh's own frame.
struct Shader::Facet {
  int car = -2, triangle = -1;
  const SynthTriangle* corners = nullptr;
  const SynthObject* object = nullptr;
  Eigen::Vector3d cross, face;               ///< twice the area; unit, as the corners turn
  Eigen::Vector3d weight_1, weight_2;        ///< barycentric coordinates from corner 0
  Eigen::Vector3d origin, along_x, along_y;  ///< of rays with one origin
};

/// Where a ray meets a surface, and what is known of the light there.
struct Shader::Point {
  std::size_t index = 0;  ///< of the ray
  const SynthObject* object = nullptr;
  int car = -1;
  Eigen::Vector3d position, view;  ///< world; the view is the ray's unit direction
  double distance = 0.0;           ///< m
  Eigen::Vector3d face, normal;    ///< world, unit, towards the viewer
  Eigen::Vector3f local;           ///< on a car: vehicle frame, m
  Eigen::Vector3f local_normal;    ///< likewise, unit
  float width = 0.0f;              ///< m, of the sample square to the ray
  Eigen::Vector2f uv, major;       ///< texture coordinates and the footprint's long side
  float minor = 0.0f;              ///< spacing of the places taken along it
  int taps = 1;
  Surface surface;
  WaterFilm water;
  float sun = 0.0f;  ///< of the sun's light: cosine, 0 in shadow
};

Shader::Shader(const SynthWorld& world, int frame) : world_(world), frame_(frame) {
  for (const SynthCar& car : world.cars) {
    const SE3& pose = car.world_from_vehicle[frame];
    cars_.push_back({pose.rotation_matrix(), pose.translation(), 0.5 * car.model.dimensions.length,
                     0.5 * car.model.dimensions.width});
  }
  sun_across_ = world.light.to_sun.unitOrthogonal();
  sun_down_ = world.light.to_sun.cross(sun_across_);
}

void Shader::shade(const SampleRays& rays, Color* light) const {
  shade(rays, world_.asphalt.wetness > 0.0f, light);
}

void Shader::shade(const SampleRays& rays, bool reflections, Color* light) const {
  std::vector<WorldHit> hits(rays.size());
  cast_rays(world_, frame_, rays.origins.data(), rays.origins.size() > 1, rays.directions.data(),
            rays.size(), hits.data());
  std::vector<Point> points;
  points.reserve(rays.size());
  Facet facet;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    if (hits[i].triangle >= 0) {
      set_facet(rays, i, hits[i], &facet);
      Point& point = points.emplace_back();
      if (locate(rays, i, facet, &point)) continue;
      points.pop_back();
    }
    light[i] = sky_light(world_, rays.directions[i]);
  }
  set_surfaces(&points);
  cast_shadows(rays, &points);
  for (const Point& point : points) light[point.index] = lit(point);
  if (reflections) add_reflections(rays, points, light);
  for (const Point& point : points) {
    const float haze =
        1.0f - std::exp(-static_cast<float>(point.distance) / world_.light.haze_distance);
    light[point.index] = mix(light[point.index], Color(0.50f, 0.54f, 0.58f), haze);
  }
}

void Shader::set_facet(const SampleRays& rays, std::size_t index, const WorldHit& hit,
                       Facet* facet) const {
  Facet& f = *facet;
  if (f.car != hit.car || f.triangle != hit.triangle) {
    const SynthMesh& mesh = hit.car < 0 ? world_.ground_and_things : world_.cars[hit.car].mesh;
    f.corners = &mesh.triangles[hit.triangle];
    f.object = &mesh.objects[f.corners->object];
    const TrianglePoints& p = f.corners->points;
    const Eigen::Vector3d e1 = p[1] - p[0], e2 = p[2] - p[0];
    f.cross = e1.cross(e2);
    const double square = f.cross.squaredNorm();
    f.face = f.cross / std::sqrt(square);
    f.weight_1 = e2.cross(f.cross) / square;
    f.weight_2 = f.cross.cross(e1) / square;
  } else if (rays.origins.size() == 1) {
    return;
  }
  f.origin = rays.origin(index);
  f.along_x = rays.along_x;
  f.along_y = rays.along_y;
  if (hit.car >= 0) {
    const auto back = cars_[hit.car].world_from_vehicle.transpose();
    f.origin = back * (f.origin - cars_[hit.car].place);
    f.along_x = back * f.along_x;
    f.along_y = back * f.along_y;
  }
  f.car = hit.car;
  f.triangle = hit.triangle;
}

bool Shader::locate(const SampleRays& rays, std::size_t index, const Facet& facet,
                    Point* point) const {
  const SynthTriangle& triangle = *facet.corners;
  const Eigen::Vector3d& seen = rays.directions[index];
  const Eigen::Vector3d direction =
      facet.car < 0 ? seen : cars_[facet.car].world_from_vehicle.transpose() * seen;
  const double facing = facet.cross.dot(direction);
  if (facing == 0.0) return false;
  const Eigen::Vector3d from_corner = facet.origin - triangle.points[0];
  const double t = -facet.cross.dot(from_corner) / facing;
  const Eigen::Vector3d local = from_corner + t * direction;  // from corner 0

  // Barycentric coordinates, kept inside the triangle: at its border the sample's centre may lie a
  // hair outside.
  double b1 = std::max(0.0, facet.weight_1.dot(local));
  double b2 = std::max(0.0, facet.weight_2.dot(local));
  if (b1 + b2 > 1.0) {
    const double sum = b1 + b2;
    b1 /= sum;
    b2 /= sum;
  }
  const auto w0 = static_cast<float>(1.0 - b1 - b2), w1 = static_cast<float>(b1),
             w2 = static_cast<float>(b2);
  Point& out = *point;
  out.index = index;
  out.object = facet.object;
  out.car = facet.car;
  out.local_normal =
      (w0 * triangle.normals[0] + w1 * triangle.normals[1] + w2 * triangle.normals[2]).normalized();
  out.uv = w0 * triangle.texture[0] + w1 * triangle.texture[1] + w2 * triangle.texture[2];

  // Footprint of the sample in texture coordinates (Igehy, "Tracing Ray Differentials", 1999).
  const Eigen::Vector2f du = triangle.texture[1] - triangle.texture[0],
                        dv = triangle.texture[2] - triangle.texture[0];
  const auto footprint = [&](const Eigen::Vector3d& change) {
    const Eigen::Vector3d moved = t * (change - (facet.cross.dot(change) / facing) * direction);
    return Eigen::Vector2f(static_cast<float>(facet.weight_1.dot(moved)) * du +
                           static_cast<float>(facet.weight_2.dot(moved)) * dv);
  };
  const Eigen::Vector2f fx = footprint(facet.along_x), fy = footprint(facet.along_y);
  out.major = fx.squaredNorm() > fy.squaredNorm() ? fx : fy;
  const float longest = out.major.norm();
  const float area = std::fabs(fx.x() * fy.y() - fx.y() * fy.x());
  out.minor = longest > 0.0f ? area / longest : 0.0f;
  out.taps = std::clamp(static_cast<int>(std::ceil(longest / std::max(out.minor, 1e-4f))), 1, 16);
  out.minor = std::max(out.minor, longest / static_cast<float>(out.taps));

  const double length = seen.norm();
  out.position = rays.origin(index) + t * seen;
  out.distance = t * length;
  out.view = seen / length;
  out.face = facing > 0.0 ? Eigen::Vector3d(-facet.face) : facet.face;
  out.normal = out.local_normal.cast<double>();
  if (facet.car >= 0) {
    out.local = (local + triangle.points[0]).cast<float>();
    out.width = static_cast<float>(t * std::max(rays.along_x.norm(), rays.along_y.norm()));
    out.face = cars_[facet.car].world_from_vehicle * out.face;
    out.normal = cars_[facet.car].world_from_vehicle * out.normal;
  }
  if (out.object->kind != SurfaceKind::kLeaf && out.normal.dot(out.face) < 0.0) {
    out.normal = -out.normal;
  }
  return true;
}

void Shader::set_surfaces(std::vector<Point>* points) const {
  std::vector<Point*> textured;
  for (Point& point : *points) {
    const SynthObject& object = *point.object;
    if (point.car >= 0) {
      point.surface = car_surface(object, point.local, point.local_normal, point.width,
                                  world_.light.lamps && world_.cars[point.car].moving);
    } else if (object.kind == SurfaceKind::kLeaf) {
      // texture: depth inside the crown (0 middle, 1 shell) and the leaf's own tone
      point.surface.albedo =
          object.color * (0.35f + 0.65f * point.uv.x()) * (0.7f + 0.6f * point.uv.y());
    } else if (object.kind == SurfaceKind::kPlain) {
      point.surface.albedo = object.color;
    } else {
      textured.push_back(&point);
    }
  }
  // Object after object, so that many places of one texture are worked on at once.
  std::stable_sort(textured.begin(), textured.end(),
                   [](const Point* a, const Point* b) { return a->object < b->object; });
  TexelBatch batch;
  for (std::size_t first = 0, last = 0; first < textured.size(); first = last) {
    const SynthObject& object = *textured[first]->object;
    batch.clear();
    for (last = first; last < textured.size() && textured[last]->object == &object; ++last) {
      const Point& point = *textured[last];
      for (int i = 0; i < point.taps; ++i) {
        const float share = (static_cast<float>(i) + 0.5f) / static_cast<float>(point.taps) - 0.5f;
        batch.add(point.uv.x() + share * point.major.x(), point.uv.y() + share * point.major.y(),
                  point.minor);
      }
    }
    batch.evaluate(world_, object);
    std::size_t at = 0;
    for (std::size_t k = first; k < last; ++k) {
      Point& point = *textured[k];
      const float part = 1.0f / static_cast<float>(point.taps);
      point.surface.albedo.setZero();
      for (int i = 0; i < point.taps; ++i, ++at) {
        point.surface.albedo += part * Color(batch.red[at], batch.green[at], batch.blue[at]);
        point.surface.mirror += part * batch.mirror[at];
      }
      if (object.kind == SurfaceKind::kAsphalt) wet(&point);
    }
  }
}

void Shader::wet(Point* point) const {
  if (world_.asphalt.wetness <= 0.0f) return;
  point->water = water_film(world_.asphalt.wetness, *point->object, {point->uv.x(), point->uv.y()},
                            std::max(point->minor, point->major.norm()));
  // Water between the grains lets less light out again (Lekner and Dorf, "Why some things are
  // darker when wet", 1988).
  point->surface.albedo *= 1.0f - 0.48f * point->water.film;
}

void Shader::cast_shadows(const SampleRays& rays, std::vector<Point>* points) const {
  constexpr double kFar = 200.0;
  std::vector<Eigen::Vector3d> origins, directions;
  std::vector<Point*> asking;
  // The sun's disc, wider behind thin clouds.
  const float radius = 0.006f + 0.05f * world_.light.cloudiness;
  for (Point& point : *points) {
    const bool leaf = point.object->kind == SurfaceKind::kLeaf;
    const auto toward = static_cast<float>(point.normal.dot(world_.light.to_sun));
    if (toward <= 0.0f || (!leaf && point.face.dot(world_.light.to_sun) <= 0.0)) continue;
    point.sun = toward;
    const std::uint32_t random = rays.random[point.index];
    const float angle = 2.0f * kPi * hash_unit(1, 0, random);
    const float away = radius * std::sqrt(hash_unit(2, 0, random));
    directions.push_back(
        (world_.light.to_sun + away * (std::cos(angle) * sun_across_ + std::sin(angle) * sun_down_))
            .normalized());
    origins.push_back(point.position + (leaf ? 0.25 * directions.back() : 0.004 * point.face));
    asking.push_back(&point);
  }
  std::vector<std::uint8_t> dark(asking.size());
  world_.rays->shaded(frame_, origins.data(), directions.data(), asking.size(), kFar, dark.data());
  for (std::size_t i = 0; i < asking.size(); ++i) {
    if (dark[i]) asking[i]->sun = 0.0f;
  }
}

/// How open the sky is above a point of the ground near the cars: 1 in the open, 0.2 under one.
float Shader::openness(const Eigen::Vector3d& position) const {
  float open = 1.0f;
  for (const CarPose& car : cars_) {
    const Eigen::Vector3d away = position - car.place;
    if (away.squaredNorm() > 16.0) continue;
    const Eigen::Vector3d local = car.world_from_vehicle.transpose() * away;
    if (std::abs(local.y()) > 0.4) continue;
    const double dx = std::abs(local.x()) - car.half_length;
    const double dz = std::abs(local.z()) - car.half_width;
    const double outside = std::hypot(std::max(dx, 0.0), std::max(dz, 0.0));
    const double signed_distance = outside > 0.0 ? outside : std::max(dx, dz);
    open *= 0.16f + 0.84f * smooth_step(-0.30f, 0.55f, static_cast<float>(signed_distance));
  }
  return open;
}

/// Light that leaves a point towards the viewer, before reflections of the road and haze.
Color Shader::lit(const Point& point) const {
  const SynthLight& light = world_.light;
  const float sun = light.sun * point.sun;
  const auto up = static_cast<float>(point.normal.z());
  float sky = light.sky * (0.5f + 0.5f * up);
  if (point.car < 0 && up > 0.5f) sky *= openness(point.position);
  const float bounce = 0.16f * (light.sky + 0.5f * light.sun) * (0.5f - 0.5f * up);
  const Color all =
      sun * Color(1.04f, 1.0f, 0.93f) + sky * Color(0.95f, 1.0f, 1.07f) + Color::Constant(bounce);
  const Surface& surface = point.surface;
  Color out = surface.albedo.cwiseProduct(all);
  if (surface.mirror > 0.0f) {
    const double cosine = std::min(1.0, std::max(0.0, -point.view.dot(point.normal)));
    const Eigen::Vector3d mirrored = point.view - 2.0 * point.view.dot(point.normal) * point.normal;
    const float grazing = std::pow(1.0f - static_cast<float>(cosine), 5.0f);
    const float share = surface.mirror + (0.75f - surface.mirror) * grazing;
    out = (1.0f - share) * out + share * mirrored_surroundings(world_, mirrored);
    const double toward = mirrored.dot(light.to_sun);
    if (sun > 0.0f && toward > 0.0) {
      out +=
          Color::Constant(2.5f * share * light.sun * static_cast<float>(std::pow(toward, 120.0)));
    }
  }
  return out + surface.emission;
}

/// Wet asphalt: the light of mirrored rays, spread by the grain where the film is thin.
void Shader::add_reflections(const SampleRays& rays, const std::vector<Point>& points,
                             Color* light) const {
  SampleRays mirrored;
  mirrored.along_x = 2.0 * rays.along_x;
  mirrored.along_y = 2.0 * rays.along_y;
  std::vector<std::size_t> index;
  std::vector<float> share;
  for (const Point& point : points) {
    if (point.water.film < 0.02f) continue;
    const std::uint32_t random = rays.random[point.index];
    const double rough = 0.11 + (0.008 - 0.11) * static_cast<double>(point.water.puddle);
    const double radius =
        rough * std::sqrt(-2.0 * std::log(1.0 - static_cast<double>(hash_unit(3, 0, random))));
    const double angle = 2.0 * kPi * static_cast<double>(hash_unit(4, 0, random));
    const Eigen::Vector3d across = point.normal.unitOrthogonal();
    const Eigen::Vector3d facet =
        (point.normal +
         radius * (std::cos(angle) * across + std::sin(angle) * point.normal.cross(across)))
            .normalized();
    const double cosine = -point.view.dot(facet);
    Eigen::Vector3d direction = point.view + 2.0 * cosine * facet;
    // What a facet throws down meets another one: level at least.
    const double rise = direction.dot(point.normal);
    if (rise < 0.02) direction += (0.02 - rise) * point.normal;
    mirrored.origins.push_back(point.position + 0.004 * point.face);
    mirrored.directions.push_back(direction.normalized());
    mirrored.random.push_back(random + 1u);
    index.push_back(point.index);
    share.push_back(water_fresnel(static_cast<float>(cosine)) *
                    (point.water.puddle + 0.6f * point.water.film * (1.0f - point.water.puddle)));
  }
  if (index.empty()) return;
  std::vector<Color> seen(index.size());
  shade(mirrored, false, seen.data());
  for (std::size_t i = 0; i < index.size(); ++i) {
    light[index[i]] = mix(light[index[i]], seen[i], share[i]);
  }
}

}  // namespace camber
