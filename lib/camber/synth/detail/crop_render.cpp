#include "camber/synth/detail/crop_render.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "camber/core/random.h"
#include "camber/detect/keypoint_crop.h"
#include "camber/image/image_io.h"

namespace camber {
namespace {

/// Places of the image, one a sample pixel: a grid of square cells.
struct Grid {
  int width = 0, height = 0;
  double x0 = 0.0, y0 = 0.0;  ///< of the first cell's middle, px of the image
  double step = 1.0;          ///< px of the image a cell
};

struct FloatImage {
  int width = 0, height = 0;
  std::vector<Color> data;
  Color& at(int x, int y) { return data[static_cast<std::size_t>(y) * width + x]; }
  const Color& at(int x, int y) const { return data[static_cast<std::size_t>(y) * width + x]; }
};

FloatImage render_light(const CropScene& scene, const Grid& grid, int k) {
  const CropCamera& camera = scene.camera;
  const double step = grid.step / k;
  const CropShader shader(scene, static_cast<float>(step) / camera.focal);
  FloatImage out{grid.width, grid.height, {}};
  out.data.assign(static_cast<std::size_t>(grid.width) * grid.height, Color::Zero());
  const auto seed = static_cast<std::uint32_t>(scene.sensor.seed);
  std::vector<Eigen::Vector3f> directions(static_cast<std::size_t>(grid.width) * k);
  std::vector<std::uint32_t> random(directions.size());
  std::vector<Color> light(directions.size());
  const float share = 1.0f / static_cast<float>(k * k);
  for (int y = 0; y < grid.height * k; ++y) {
    const double v = grid.y0 + grid.step * ((y + 0.5) / k - 0.5);
    for (int x = 0; x < grid.width * k; ++x) {
      const double u = grid.x0 + grid.step * ((x + 0.5) / k - 0.5);
      directions[x] = camera.ray({static_cast<float>(u), static_cast<float>(v)});
      random[x] = hash_lattice(x, y, seed);
    }
    shader.shade(directions, random, light.data());
    for (int x = 0; x < grid.width * k; ++x) {
      // A sensor's pixel is full at some point: one glint does not whiten its neighbours.
      out.at(x / k, y / k) += share * light[x].cwiseMax(0.0f).cwiseMin(4.0f);
    }
  }
  return out;
}

void blur_lines(const std::vector<float>& weights, bool down, FloatImage* image) {
  const int reach = static_cast<int>(weights.size()) / 2;
  FloatImage out = *image;
  for (int y = 0; y < image->height; ++y) {
    for (int x = 0; x < image->width; ++x) {
      Color sum = Color::Zero();
      for (int i = -reach; i <= reach; ++i) {
        const int u = down ? x : std::clamp(x + i, 0, image->width - 1);
        const int v = down ? std::clamp(y + i, 0, image->height - 1) : y;
        sum += weights[i + reach] * image->at(u, v);
      }
      out.at(x, y) = sum;
    }
  }
  *image = std::move(out);
}

/// @param sigma  cells
void blur(float sigma, FloatImage* image) {
  if (sigma < 0.2f) return;
  const int reach = std::max(1, static_cast<int>(std::ceil(2.5f * sigma)));
  std::vector<float> weights;
  float sum = 0.0f;
  for (int i = -reach; i <= reach; ++i) {
    const auto x = static_cast<float>(i);
    weights.push_back(std::exp(-0.5f * x * x / (sigma * sigma)));
    sum += weights.back();
  }
  for (float& w : weights) w /= sum;
  blur_lines(weights, false, image);
  blur_lines(weights, true, image);
}

/// @param length  cells
void smear(float length, float angle, FloatImage* image) {
  const int taps = static_cast<int>(std::ceil(2.0f * length));
  if (taps < 2) return;
  FloatImage out = *image;
  for (int y = 0; y < image->height; ++y) {
    for (int x = 0; x < image->width; ++x) {
      Color sum = Color::Zero();
      for (int i = 0; i < taps; ++i) {
        const float away =
            length * ((static_cast<float>(i) + 0.5f) / static_cast<float>(taps) - 0.5f);
        const int u = static_cast<int>(std::lround(static_cast<float>(x) + away * std::cos(angle)));
        const int v = static_cast<int>(std::lround(static_cast<float>(y) + away * std::sin(angle)));
        sum += image->at(std::clamp(u, 0, image->width - 1), std::clamp(v, 0, image->height - 1));
      }
      out.at(x, y) = sum / static_cast<float>(taps);
    }
  }
  *image = std::move(out);
}

/// The response of sensor and file to light; the outcome in grey levels.
void respond(const CropSensor& sensor, float noise_scale, FloatImage* image) {
  constexpr float kRed = 0.299f, kGreen = 0.587f, kBlue = 0.114f;
  const Color luma(kRed, kGreen, kBlue);
  // The whole picture is exposed; the car, about its middle half, not into full darkness.
  float mean = 0.0f, middle = 0.0f, in_middle = 0.0f;
  for (int y = 0; y < image->height; ++y) {
    for (int x = 0; x < image->width; ++x) {
      const float grey = luma.dot(image->at(x, y).cwiseMin(2.0f));
      mean += grey;
      if (std::abs(4 * x - 2 * image->width) > image->width ||
          std::abs(4 * y - 2 * image->height) > image->height) {
        continue;
      }
      middle += grey;
      in_middle += 1.0f;
    }
  }
  mean /= static_cast<float>(image->data.size());
  middle /= std::max(1.0f, in_middle);
  const float gain =
      std::max(sensor.brightness / std::max(1e-4f, mean), sensor.darkest / std::max(1e-4f, middle));
  const CounterRandom random(sensor.seed, 0x4E4F4953u);
  for (std::size_t i = 0; i < image->data.size(); ++i) {
    Color c = gain * image->data[i].cwiseProduct(sensor.gains);
    const float grey = luma.dot(c);
    c = (Color::Constant(grey) + sensor.saturation * (c - Color::Constant(grey)));
    for (int k = 0; k < 3; ++k) {
      const float x = clamp01(c[k]);
      float y = std::pow(x, 1.0f / sensor.gamma);
      y = sensor.contrast >= 0.0f ? y + sensor.contrast * (y * y * (3.0f - 2.0f * y) - y)
                                  : 0.5f + (y - 0.5f) * (1.0f + sensor.contrast);
      const float sigma = noise_scale * (sensor.noise + sensor.shot * std::sqrt(y));
      c[k] = 255.0f * y + sigma * static_cast<float>(random.normal(3 * i + k));
    }
    image->data[i] = c;
  }
}

/// One colour a pixel (red and blue on every fourth), the others from their neighbours.
void interpolate_mosaic(FloatImage* image) {
  const FloatImage in = *image;
  const auto channel = [](int x, int y) { return (x & 1) == (y & 1) ? 1 : ((x & 1) ? 0 : 2); };
  for (int y = 0; y < in.height; ++y) {
    for (int x = 0; x < in.width; ++x) {
      Color sum = Color::Zero(), count = Color::Zero();
      const int own = channel(x, y);
      for (int v = std::max(0, y - 1); v <= std::min(in.height - 1, y + 1); ++v) {
        for (int u = std::max(0, x - 1); u <= std::min(in.width - 1, x + 1); ++u) {
          const int c = channel(u, v);
          sum[c] += in.at(u, v)[c];
          count[c] += 1.0f;
        }
      }
      Color& out = image->at(x, y);
      for (int c = 0; c < 3; ++c) {
        if (c != own && count[c] > 0.0f) out[c] = sum[c] / count[c];
      }
    }
  }
}

Image to_bytes(const FloatImage& image) {
  Image out{image.width, image.height, 3, {}};
  out.data.reserve(3 * image.data.size());
  for (const Color& c : image.data) {
    for (int k = 0; k < 3; ++k) {
      out.data.push_back(static_cast<std::uint8_t>(std::clamp(std::lround(c[k]), 0l, 255l)));
    }
  }
  return out;
}

void compress(int quality, Image* image) {
  if (quality <= 0) return;
  *image = decode_color_image(encode_jpeg(*image, quality), "crop");
}

/// Light to bytes on the grid. @param cell  px of the image a cell
Image expose(const CropSensor& sensor, float cell, FloatImage image) {
  blur(sensor.blur / cell, &image);
  if (sensor.motion > 0.0f) smear(sensor.motion / cell, sensor.motion_angle, &image);
  respond(sensor, 1.0f / std::max(1.0f, cell), &image);
  if (sensor.mosaic && cell < 1.5f) interpolate_mosaic(&image);
  Image out = to_bytes(image);
  // Artefacts shrink with the image.
  if (sensor.jpeg > 0) {
    compress(static_cast<int>(std::lround(100.0f - static_cast<float>(100 - sensor.jpeg) /
                                                       std::max(1.0f, cell))),
             &out);
  }
  return out;
}

bool in_image(const CropCamera& camera, const Eigen::Vector2d& pixel) {
  return pixel.x() >= -0.5 && pixel.y() >= -0.5 && pixel.x() < camera.width - 0.5 &&
         pixel.y() < camera.height - 0.5;
}

}  // namespace

Image render_crop(const CropScene& scene, int size) {
  const KeypointCrop crop = keypoint_crop(scene.box, size);
  const CropCamera& camera = scene.camera;
  if (crop.scale() >= 1.0) {
    const Eigen::Vector2d first = crop.to_image({0.0, 0.0});
    const Grid grid{size, size, first.x(), first.y(), crop.scale()};
    Image out = expose(scene.sensor, static_cast<float>(grid.step), render_light(scene, grid, 2));
    for (int y = 0; y < size; ++y) {
      for (int x = 0; x < size; ++x) {
        if (in_image(camera, crop.to_image({x, y}))) continue;
        std::fill_n(out.data.begin() + 3 * (static_cast<std::ptrdiff_t>(y) * size + x), 3,
                    static_cast<std::uint8_t>(kKeypointCropPadding));
      }
    }
    return out;
  }
  // The image's own pixels that the crop needs.
  const Eigen::Vector2d low = crop.to_image({-1.0, -1.0}), high = crop.to_image({size, size});
  const int x0 = std::clamp(static_cast<int>(std::floor(low.x())), 0, camera.width - 1);
  const int y0 = std::clamp(static_cast<int>(std::floor(low.y())), 0, camera.height - 1);
  const int x1 = std::clamp(static_cast<int>(std::ceil(high.x())), x0, camera.width - 1);
  const int y1 = std::clamp(static_cast<int>(std::ceil(high.y())), y0, camera.height - 1);
  const Grid grid{x1 - x0 + 1, y1 - y0 + 1, static_cast<double>(x0), static_cast<double>(y0), 1.0};
  const int k = std::clamp(2 * size / std::max(grid.width, grid.height), 2, 4);
  const Image image = expose(scene.sensor, 1.0f, render_light(scene, grid, k));
  return cut_crop(image, {crop.center - Eigen::Vector2d(x0, y0), crop.side, size});
}

}  // namespace camber
