#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "camber/geometry/box.h"
#include "camber/image/image_io.h"

namespace camber {

struct Color {
  std::uint8_t red = 0, green = 0, blue = 0;
  double alpha = 1.0;  ///< opacity in [0, 1]

  Color with_alpha(double a) const { return {red, green, blue, a}; }
};

using Segment2 = std::pair<Eigen::Vector2d, Eigen::Vector2d>;

/// Where the given point lies in a line of text: (0, 0) its left end and middle, (1, 0) right.
enum class TextAnchor { kLeft, kCenter, kRight };

/// Anti-aliased drawing with opacity onto a picture. Coordinates are pixels with pixel centres at
/// integers; shapes may reach outside and are clipped. Everything of one call is blended at once,
/// so that overlapping lines of a call do not add up. Not for use from several threads on one
/// picture.
class Canvas {
 public:
  /// @throws std::invalid_argument for an empty picture or one without colours.
  explicit Canvas(Image& image);

  int width() const { return image_->width; }
  int height() const { return image_->height; }

  void segments(const std::vector<Segment2>& lines, double thickness, const Color& color);
  void polyline(const std::vector<Eigen::Vector2d>& points, bool closed, double thickness,
                const Color& color);
  /// Segments cut into dashes of the given lengths, pixels.
  void dashed(const std::vector<Segment2>& lines, double dash, double gap, double thickness,
              const Color& color);
  /// Filled polygon, simple, any number of corners.
  void polygon(const std::vector<Eigen::Vector2d>& corners, const Color& color);
  void rectangle(const Box2& box, const Color& color, double corner_radius = 0.0);
  void disc(const Eigen::Vector2d& center, double radius, const Color& color);

  /// One line of text, UTF-8 (Latin-1 letters, degree, plus-minus), middle of its height at `at`.
  /// @param size  pixels, height of a line (capitals are about 0.7 of it).
  void text(const Eigen::Vector2d& at, const std::string& line, double size, const Color& color,
            TextAnchor anchor = TextAnchor::kLeft, bool bold = false);
  /// The same with a soft rim of the given colour, readable on any ground.
  void text_with_halo(const Eigen::Vector2d& at, const std::string& line, double size,
                      const Color& color, const Color& halo, TextAnchor anchor = TextAnchor::kLeft,
                      bool bold = false);
  /// The same, turned a quarter to the left (reads upwards), middle of the line at `at`.
  void text_upwards(const Eigen::Vector2d& at, const std::string& line, double size,
                    const Color& color);

  /// Width (x) and height (y) in pixels that text() covers.
  static Eigen::Vector2d text_size(const std::string& line, double size, bool bold = false);

 private:
  Image* image_;
};

/// The part of a segment inside a box grown by `margin`; false: nothing of it.
bool clip_segment(const Box2& box, Eigen::Vector2d* a, Eigen::Vector2d* b);

}  // namespace camber
