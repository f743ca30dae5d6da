#include "camber/synth/detail/sky.h"

#include <Eigen/Geometry>
#include <cmath>

namespace camber {

Color sky_light(const SynthWorld& world, const Eigen::Vector3d& direction) {
  const Eigen::Vector3f d = direction.normalized().cast<float>();
  const float cloudiness = world.light.cloudiness;
  const Color zenith = mix(Color(0.13f, 0.25f, 0.52f), Color(0.42f, 0.45f, 0.50f), cloudiness);
  const Color horizon = mix(Color(0.50f, 0.57f, 0.66f), Color(0.58f, 0.60f, 0.62f), cloudiness);
  const auto seed = static_cast<std::uint32_t>(world.road.layout().seed) + 900u;

  // Hills all around, one nearer and one farther range.
  const float azimuth = std::atan2(d.y(), d.x());
  const Texel round{4.0f * std::cos(azimuth), 4.0f * std::sin(azimuth)};
  const auto ridge = [&](float base, float rough, std::uint32_t s) {
    return base + rough * (0.6f * gradient_noise(0.5f * round, s) +
                           0.3f * gradient_noise(1.7f * round, s + 1) +
                           0.08f * gradient_noise(7.0f * round, s + 2) +
                           0.04f * gradient_noise(23.0f * round, s + 3));
  };
  const float blur = 0.0012f;  // rad, about one pixel
  const float elevation = std::asin(std::clamp(d.z(), -1.0f, 1.0f));

  Color sky = mix(horizon, zenith, smooth_step(0.0f, 0.9f, std::max(0.0f, d.z())));
  if (d.z() > 0.01f) {
    const float k = 1.0f / (d.z() + 0.08f);
    const Texel plane{d.x() * k, d.y() * k};
    const float near_horizon = smooth_step(0.01f, 0.15f, d.z());
    float cover = 0.55f * gradient_noise(0.7f * plane, seed) +
                  0.30f * gradient_noise(1.9f * plane, seed + 1) +
                  0.16f * gradient_noise(4.3f * plane, seed + 2) +
                  0.08f * near_horizon * gradient_noise(10.0f * plane, seed + 3);
    cover = smooth_step(0.25f - 0.6f * cloudiness, 0.75f - 0.4f * cloudiness, cover + 0.15f);
    const Color cloud = mix(Color(0.80f, 0.80f, 0.80f), Color(0.52f, 0.54f, 0.57f), cloudiness);
    sky = mix(sky, cloud, 0.85f * cover * near_horizon);
  }
  const float far_ridge = ridge(0.045f, 0.05f, seed + 10),
              near_ridge = ridge(0.012f, 0.045f, seed + 20);
  const Color far_hill(0.36f, 0.44f, 0.50f);
  const float woods = 0.15f * gradient_noise({30.0f * azimuth, 60.0f * elevation}, seed + 30) +
                      0.1f * gradient_noise({90.0f * azimuth, 150.0f * elevation}, seed + 31);
  const Color near_hill = Color(0.20f, 0.26f, 0.20f) * std::exp(woods);
  sky = mix(sky, far_hill, below_edge(elevation - far_ridge, blur));
  return mix(sky, near_hill, below_edge(elevation - near_ridge, blur));
}

Color mirrored_surroundings(const SynthWorld& world, const Eigen::Vector3d& direction) {
  const Eigen::Vector3d d = direction.normalized();
  const auto up = static_cast<float>(d.z());
  const Color ground(0.13f, 0.13f, 0.12f), far(0.22f, 0.23f, 0.21f);
  if (up < 0.0f) return mix(far, ground, smooth_step(0.0f, 0.15f, -up));
  const Color sky = sky_light(world, Eigen::Vector3d(d.x(), d.y(), std::max(0.12, d.z())));
  return mix(far, 0.8f * sky, smooth_step(0.04f, 0.30f, up));
}

}  // namespace camber
