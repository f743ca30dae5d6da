#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "camber/synth/detail/crop_scene.h"

namespace camber {

struct CropShader::Point {
  std::size_t index = 0;  ///< of the sample
  int place = 0;
  Eigen::Vector3f position, view, face, normal;  ///< world; view: unit, from the eye
  CropSurface surface;
  float sun = 0.0f;  ///< cosine to the sun, 0 in shadow
};

void CropShader::shade(const std::vector<Eigen::Vector3f>& directions,
                       const std::vector<std::uint32_t>& random, Color* light) const {
  std::vector<CropRays::Hit> hits(directions.size());
  scene_.rays->nearest(&scene_.camera.eye, false, directions.data(), directions.size(),
                       hits.data());
  std::vector<Point> points;
  points.reserve(directions.size());
  for (std::size_t i = 0; i < directions.size(); ++i) {
    Point& point = points.emplace_back();
    point.index = i;
    if (!locate(hits[i], scene_.camera.eye, directions[i], &point)) {
      points.pop_back();
      light[i] = scene_.environment.light(directions[i].normalized(), pixel_);
    }
  }
  cast_shadows(random, &points);
  for (const Point& point : points) light[point.index] = lit(point);
  see_through(points, light);
  for (const Point& point : points) {
    light[point.index] = scene_.environment.through_air(
        light[point.index], (point.position - scene_.camera.eye).norm());
  }
}

bool CropShader::locate(const CropRays::Hit& hit, const Eigen::Vector3f& origin,
                        const Eigen::Vector3f& direction, Point* out) const {
  if (hit.place < 0) return false;
  const MeshPlace& place = scene_.places[hit.place];
  const CropMesh& mesh = *place.mesh;
  const Eigen::Vector3i& t = mesh.triangles[hit.triangle];
  const Eigen::Vector3f &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]],
                        &c = mesh.vertices[t[2]];
  const Eigen::Vector3f cross = (b - a).cross(c - a);
  const float square = cross.squaredNorm();
  out->place = hit.place;
  out->position = origin + hit.distance * direction;
  const Eigen::Vector3f local = place.rotation.transpose() * (out->position - place.origin);
  const float w1 = clamp01((local - a).cross(c - a).dot(cross) / square);
  const float w2 = clamp01((b - a).cross(local - a).dot(cross) / square);
  const auto& n = mesh.normals[hit.triangle];
  const Eigen::Vector3f normal = ((1.0f - w1 - w2) * n[0] + w1 * n[1] + w2 * n[2]).normalized();
  const float length = direction.norm();
  out->view = direction / length;
  const float width = hit.distance * length * pixel_;
  const std::uint8_t material = mesh.materials[hit.triangle];
  if (const CropCar* car = scene_.cars[hit.place]) {
    out->surface =
        crop_car_surface(car->places, scene_.looks[hit.place], material, local, normal, width);
  } else if (scene_.leaves[hit.place] > 0) {
    const CropTexture& leaves = scene_.textures[scene_.leaves[hit.place]];
    const float tone = hash_unit(hit.triangle / 2, 0, leaves.seed);
    out->surface.albedo = leaves.a * (0.45f + 0.9f * tone);
  } else {
    const Eigen::Vector3f f = cross.cwiseAbs();
    const bool level = f.z() > f.x() && f.z() > f.y();
    const Texel uv =
        level ? Texel{local.x(), local.y()}
              : (f.x() > f.y() ? Texel{local.y(), local.z()} : Texel{local.x(), local.z()});
    const float facing = std::fabs(out->view.dot(normal));
    const CropTexture& texture = scene_.textures[material];
    out->surface.albedo = texture.at(uv, width / std::sqrt(std::max(0.02f, facing)));
    out->surface.mirror = texture.mirror;
    out->surface.roughness = 0.3f;
  }
  out->face = place.rotation * (cross / std::sqrt(square));
  out->normal = place.rotation * normal;
  if (out->face.dot(out->view) > 0.0f) out->face = -out->face;
  if (scene_.leaves[hit.place] == 0 && out->normal.dot(out->face) < 0.0f) {
    out->normal = -out->normal;
  }
  return true;
}

void CropShader::cast_shadows(const std::vector<std::uint32_t>& random,
                              std::vector<Point>* points) const {
  const CropEnvironment& e = scene_.environment;
  if (!(e.sun > 0.0f)) return;
  const Eigen::Vector3f across = e.to_sun.unitOrthogonal(), down = e.to_sun.cross(across);
  std::vector<Eigen::Vector3f> origins, directions;
  std::vector<Point*> asking;
  origins.reserve(points->size());
  directions.reserve(points->size());
  asking.reserve(points->size());
  for (Point& point : *points) {
    const bool leaf = scene_.leaves[point.place] > 0;
    const float toward = point.normal.dot(e.to_sun);
    if (toward <= 0.0f || (!leaf && point.face.dot(e.to_sun) <= 0.0f)) continue;
    point.sun = toward;
    const float angle = 6.2831853f * hash_unit(1, 0, random[point.index]);
    const float away = e.sun_radius * std::sqrt(hash_unit(2, 0, random[point.index]));
    directions.push_back(
        (e.to_sun + away * (std::cos(angle) * across + std::sin(angle) * down)).normalized());
    origins.push_back(point.position + (leaf ? 0.2f * directions.back() : 0.01f * point.face));
    asking.push_back(&point);
  }
  std::vector<std::uint8_t> dark(asking.size());
  scene_.rays->shaded(origins.data(), directions.data(), asking.size(), dark.data());
  for (std::size_t i = 0; i < asking.size(); ++i) {
    if (dark[i]) {
      asking[i]->sun = 0.0f;
    } else if (e.foliage > 0.0f) {
      asking[i]->sun *=
          e.below_foliage(across.dot(asking[i]->position), down.dot(asking[i]->position));
    }
  }
}

/// How open the sky is above a point of the ground: 1 in the open, 0.16 under a car.
float CropShader::openness(const Eigen::Vector3f& position) const {
  float open = 1.0f;
  for (std::size_t i = 0; i < scene_.places.size(); ++i) {
    if (!scene_.cars[i]) continue;
    const MeshPlace& place = scene_.places[i];
    const Eigen::Vector3f away = position - place.origin;
    if (away.squaredNorm() > 16.0f) continue;
    const Eigen::Vector3f local = place.rotation.transpose() * away;
    if (std::fabs(local.y()) > 0.5f) continue;
    const float dx = std::fabs(local.x()) - 0.5f * scene_.cars[i]->places.length;
    const float dz = std::fabs(local.z()) - scene_.cars[i]->places.half_width;
    const float outside = std::hypot(std::max(dx, 0.0f), std::max(dz, 0.0f));
    const float signed_distance = outside > 0.0f ? outside : std::max(dx, dz);
    open *= 0.12f + 0.88f * smooth_step(-0.30f, 0.6f, signed_distance);
  }
  return open;
}

Color CropShader::lit(const Point& point) const {
  const CropEnvironment& e = scene_.environment;
  const CropCar* car = scene_.cars[point.place];
  const float up = point.normal.dot(e.up);
  const float sun = e.sun * point.sun;
  float sky = e.sky * (0.5f + 0.5f * up);
  if (!car && point.normal.z() > 0.5f) sky *= openness(point.position);
  if (car) {  // the lower parts see less of the sky
    sky *= 0.55f + 0.45f * smooth_step(0.0f, 0.8f,
                                       point.position.z() - scene_.places[point.place].origin.z());
  }
  const float level = std::max(0.0f, e.to_sun.dot(e.up));
  const Color bounce = e.ground * (e.sky + 0.7f * e.sun * level) * (0.5f - 0.5f * up);
  const CropSurface& s = point.surface;
  Color albedo = s.albedo;
  const float cosine = clamp01(-point.view.dot(point.normal));
  if (car && s.mirror > 0.0f && s.mirror < 0.5f) {
    albedo *= 1.0f + scene_.looks[point.place].flake * (cosine * cosine - 0.45f);
  }
  Color out = albedo.cwiseProduct(sun * e.sun_color + sky * e.sky_color + bounce);
  if (s.mirror > 0.0f) {
    const Eigen::Vector3f mirrored =
        point.view - 2.0f * point.view.dot(point.normal) * point.normal;
    const float grazing = 1.0f - cosine;
    const float share = s.mirror + (0.7f - std::min(0.7f, s.mirror)) * std::pow(grazing, 5.0f);
    Color seen = e.light(mirrored, std::max(s.roughness, 0.02f));
    if (point.sun > 0.0f) {
      const float away = std::max(0.0f, 1.0f - mirrored.dot(e.to_sun));
      const float spread = 0.0008f + s.roughness * s.roughness;
      seen += 0.02f / spread * sun * std::exp(-away / spread) * e.sun_color;
    }
    out = (1.0f - share) * out + share * seen;
  }
  return out + s.emission;
}

/// What is behind glass: the cabin, or through the glass of another side what is beyond the car.
void CropShader::see_through(const std::vector<Point>& points, Color* light) const {
  constexpr float kStep = 0.004f;
  std::vector<std::size_t> glass;
  std::vector<Eigen::Vector3f> origins, directions;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (points[i].surface.clear < 0.05f) continue;
    glass.push_back(i);
    origins.push_back(points[i].position + kStep * points[i].view);
    directions.push_back(points[i].view);
  }
  if (glass.empty()) return;
  std::vector<CropRays::Hit> hits(glass.size());
  scene_.rays->nearest(origins.data(), true, directions.data(), glass.size(), hits.data());
  std::vector<float> passes(glass.size(), 0.0f);
  std::vector<std::size_t> beyond;
  std::vector<Eigen::Vector3f> outer, onward;
  for (std::size_t j = 0; j < glass.size(); ++j) {
    const Point& front = points[glass[j]];
    const float clear = front.surface.clear;
    Point inner;
    if (!locate(hits[j], origins[j], directions[j], &inner) || inner.place != front.place) continue;
    if (inner.surface.clear > 0.05f) {
      passes[j] = clear * inner.surface.clear;
      beyond.push_back(j);
      outer.push_back(inner.position + kStep * directions[j]);
      onward.push_back(directions[j]);
    } else {
      const CropMesh& mesh = *scene_.places[front.place].mesh;
      const bool seat =
          mesh.materials[hits[j].triangle] == static_cast<std::uint8_t>(CropCarMaterial::kCabin);
      const Color cabin = (seat ? 2.0f : 0.7f) * scene_.looks[front.place].interior *
                          scene_.environment.sky *
                          (0.5f + 0.5f * clamp01(inner.normal.dot(scene_.environment.up)));
      light[front.index] += clear * cabin;
    }
  }
  if (beyond.empty()) return;
  hits.resize(beyond.size());
  scene_.rays->nearest(outer.data(), true, onward.data(), beyond.size(), hits.data());
  for (std::size_t k = 0; k < beyond.size(); ++k) {
    const std::size_t j = beyond[k];
    Point far;
    Color seen;
    if (locate(hits[k], outer[k], onward[k], &far)) {
      far.sun = std::max(0.0f, far.normal.dot(scene_.environment.to_sun));
      seen = lit(far);
    } else {
      seen = scene_.environment.light(onward[k], pixel_);
    }
    light[points[glass[j]].index] += passes[j] * seen;
  }
}

}  // namespace camber
