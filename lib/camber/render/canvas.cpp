#include "camber/render/canvas.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <opencv2/imgproc.hpp>
#include <tuple>

#include "camber/render/detail/vtk_drawing.h"
#include "camber/render/picture_file.h"

namespace camber {
namespace {

constexpr int kShift = 4;  // fractional bits of OpenCV's drawing coordinates
constexpr double kOne = 1 << kShift;

cv::Point fixed_point(const Eigen::Vector2d& p) {
  return {static_cast<int>(std::lround(p.x() * kOne)), static_cast<int>(std::lround(p.y() * kOne))};
}

/// Opacity of some shapes, on the part of the picture that they can touch.
class Mask {
 public:
  /// @param reach  what the shapes may cover; pixels.
  Mask(const Image& image, const Box2& reach) {
    const auto inside = [](double at, int size) {
      return std::min(std::max(-2.0, at), size + 1.0);
    };
    const int x1 = std::max(0, static_cast<int>(std::floor(inside(reach.x1, image.width))) - 1);
    const int y1 = std::max(0, static_cast<int>(std::floor(inside(reach.y1, image.height))) - 1);
    const int x2 = static_cast<int>(std::ceil(inside(reach.x2, image.width))) + 2;
    const int y2 = static_cast<int>(std::ceil(inside(reach.y2, image.height))) + 2;
    area_ = cv::Rect(x1, y1, std::min(x2, image.width) - x1, std::min(y2, image.height) - y1);
    if (area_.width <= 0 || area_.height <= 0) {
      area_ = cv::Rect();
      return;
    }
    alpha_ = cv::Mat::zeros(area_.height, area_.width, CV_8U);
  }

  bool empty() const { return area_.width == 0; }
  Eigen::Vector2d local(const Eigen::Vector2d& p) const {
    return p - Eigen::Vector2d(area_.x, area_.y);
  }
  cv::Mat& alpha() { return alpha_; }
  const cv::Rect& area() const { return area_; }

  /// The part of a segment near the mask; OpenCV's fixed-point coordinates must not overflow.
  bool clip(Eigen::Vector2d* a, Eigen::Vector2d* b, double margin) const {
    if (!a->allFinite() || !b->allFinite()) return false;
    const Box2 box{area_.x - margin, area_.y - margin, area_.x + area_.width + margin,
                   area_.y + area_.height + margin};
    return clip_segment(box, a, b);
  }

  void line(Eigen::Vector2d a, Eigen::Vector2d b, double thickness) {
    if (!clip(&a, &b, thickness + 4.0)) return;
    a = local(a);
    b = local(b);
    if (thickness <= 1.0) {
      cv::line(alpha_, fixed_point(a), fixed_point(b),
               cv::Scalar(255.0 * std::max(0.25, thickness)), 1, cv::LINE_AA, kShift);
      return;
    }
    // A box of the exact width with round ends: cv::line knows whole widths only.
    const Eigen::Vector2d along = b - a;
    const double length = along.norm();
    const double radius = 0.5 * thickness;
    if (length > 1e-9) {
      const Eigen::Vector2d side = Eigen::Vector2d(-along.y(), along.x()) * (radius / length);
      const cv::Point corners[4] = {fixed_point(a + side), fixed_point(b + side),
                                    fixed_point(b - side), fixed_point(a - side)};
      cv::fillConvexPoly(alpha_, corners, 4, cv::Scalar(255), cv::LINE_AA, kShift);
    }
    if (thickness >= 2.0) {
      const int r = static_cast<int>(std::lround((radius - 0.5) * kOne));
      cv::circle(alpha_, fixed_point(a), r, cv::Scalar(255), cv::FILLED, cv::LINE_AA, kShift);
      cv::circle(alpha_, fixed_point(b), r, cv::Scalar(255), cv::FILLED, cv::LINE_AA, kShift);
    }
  }

  void blend(Image& image, const Color& color) const {
    if (empty()) return;
    const int opacity = static_cast<int>(std::lround(256.0 * std::clamp(color.alpha, 0.0, 1.0)));
    const int ink[3] = {color.red, color.green, color.blue};
    for (int y = 0; y < area_.height; ++y) {
      const std::uint8_t* alpha = alpha_.ptr<std::uint8_t>(y);
      std::uint8_t* out =
          &image.data[3 * (static_cast<std::size_t>(area_.y + y) * image.width + area_.x)];
      for (int x = 0; x < area_.width; ++x, out += 3) {
        if (alpha[x] == 0) continue;
        const int a = alpha[x] * opacity;  // 0 to 255 * 256
        for (int c = 0; c < 3; ++c) {
          out[c] = static_cast<std::uint8_t>((out[c] * (65280 - a) + ink[c] * a + 32640) / 65280);
        }
      }
    }
  }

 private:
  cv::Rect area_;
  cv::Mat alpha_;
};

template <typename Points>
Box2 bounds(const Points& points, double margin) {
  Box2 box{1e30, 1e30, -1e30, -1e30};
  for (const Eigen::Vector2d& p : points) {
    if (!p.allFinite()) continue;
    box = {std::min(box.x1, p.x()), std::min(box.y1, p.y()), std::max(box.x2, p.x()),
           std::max(box.y2, p.y())};
  }
  return box.grown(margin);
}

Box2 bounds(const std::vector<Segment2>& lines, double margin) {
  std::vector<Eigen::Vector2d> ends;
  ends.reserve(2 * lines.size());
  for (const Segment2& line : lines) {
    ends.push_back(line.first);
    ends.push_back(line.second);
  }
  return bounds(ends, margin);
}

/// Sutherland and Hodgman's clipping of a polygon at a box.
std::vector<Eigen::Vector2d> clip_polygon(std::vector<Eigen::Vector2d> in, const Box2& box) {
  const double limits[4] = {box.x1, box.y1, -box.x2, -box.y2};
  for (int side = 0; side < 4 && !in.empty(); ++side) {
    const auto inside = [&](const Eigen::Vector2d& p) {
      return (side < 2 ? p[side] : -p[side - 2]) - limits[side];
    };
    std::vector<Eigen::Vector2d> out;
    for (std::size_t i = 0; i < in.size(); ++i) {
      const Eigen::Vector2d& a = in[i];
      const Eigen::Vector2d& b = in[(i + 1) % in.size()];
      const double da = inside(a), db = inside(b);
      if (da >= 0.0) out.push_back(a);
      if ((da >= 0.0) != (db >= 0.0)) out.push_back(a + (b - a) * (da / (da - db)));
    }
    in = std::move(out);
  }
  return in;
}

/// Opacity of one line of text, rows from the top.
/// VTK's own font has no plus-minus sign: "+/-" stands for it.
std::string drawable(std::string line) {
  const std::string sign = "±";
  for (std::size_t at = 0; (at = line.find(sign, at)) != std::string::npos;) {
    line.replace(at, sign.size(), "+/-");
  }
  return line;
}

cv::Mat rasterize(const std::string& line, int size, bool bold) {
  static std::mutex mutex;  // VTK's FreeType cache is one for the process
  static std::map<std::tuple<std::string, int, bool>, cv::Mat> cache;
  const std::lock_guard<std::mutex> lock(mutex);
  const auto key = std::make_tuple(line, size, bold);
  const auto found = cache.find(key);
  if (found != cache.end()) return found->second;
  TextBitmap text = rasterize_text(drawable(line), size, bold);
  cv::Mat alpha;
  if (text.width > 0) {
    alpha = cv::Mat(text.height, text.width, CV_8U, text.opacity.data()).clone();
  }
  if (cache.size() > 4096) cache.clear();
  cache.emplace(key, alpha);
  return alpha;
}

int font_size(double size) { return std::max(6, static_cast<int>(std::lround(0.8 * size))); }

/// Copies a text bitmap into a mask; what reaches outside is cut off.
void stamp(const cv::Mat& bitmap, int left, int top, Mask& mask) {
  const cv::Rect place(left - mask.area().x, top - mask.area().y, bitmap.cols, bitmap.rows);
  const cv::Rect inside = place & cv::Rect(0, 0, mask.area().width, mask.area().height);
  if (inside.empty()) return;
  bitmap(inside - place.tl()).copyTo(mask.alpha()(inside));
}

cv::Point text_corner(const Eigen::Vector2d& at, const cv::Mat& bitmap, TextAnchor anchor) {
  const double share = anchor == TextAnchor::kLeft     ? 0.0
                       : anchor == TextAnchor::kCenter ? 0.5
                                                       : 1.0;
  return {static_cast<int>(std::lround(at.x() - share * bitmap.cols)),
          static_cast<int>(std::lround(at.y() - 0.5 * bitmap.rows))};
}

}  // namespace

bool clip_segment(const Box2& box, Eigen::Vector2d* a, Eigen::Vector2d* b) {
  // Liang and Barsky.
  const Eigen::Vector2d d = *b - *a;
  double t0 = 0.0, t1 = 1.0;
  const double p[4] = {-d.x(), d.x(), -d.y(), d.y()};
  const double q[4] = {a->x() - box.x1, box.x2 - a->x(), a->y() - box.y1, box.y2 - a->y()};
  for (int i = 0; i < 4; ++i) {
    if (p[i] == 0.0) {
      if (q[i] < 0.0) return false;
      continue;
    }
    const double t = q[i] / p[i];
    if (p[i] < 0.0) {
      t0 = std::max(t0, t);
    } else {
      t1 = std::min(t1, t);
    }
  }
  if (t0 > t1) return false;
  const Eigen::Vector2d start = *a;
  *a = start + t0 * d;
  *b = start + t1 * d;
  return true;
}

Canvas::Canvas(Image& image) : image_(&image) { require_picture(image, "picture"); }

void Canvas::segments(const std::vector<Segment2>& lines, double thickness, const Color& color) {
  Mask mask(*image_, bounds(lines, thickness + 1.0));
  if (mask.empty()) return;
  for (const Segment2& line : lines) mask.line(line.first, line.second, thickness);
  mask.blend(*image_, color);
}

void Canvas::polyline(const std::vector<Eigen::Vector2d>& points, bool closed, double thickness,
                      const Color& color) {
  std::vector<Segment2> lines;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) lines.emplace_back(points[i], points[i + 1]);
  if (closed && points.size() > 2) lines.emplace_back(points.back(), points.front());
  segments(lines, thickness, color);
}

void Canvas::dashed(const std::vector<Segment2>& lines, double dash, double gap, double thickness,
                    const Color& color) {
  std::vector<Segment2> dashes;
  for (const Segment2& line : lines) {
    Eigen::Vector2d a = line.first, b = line.second;
    if (!a.allFinite() || !b.allFinite() ||
        !clip_segment({-50.0, -50.0, width() + 50.0, height() + 50.0}, &a, &b)) {
      continue;
    }
    const double length = (b - a).norm();
    const Eigen::Vector2d along = (b - a) / std::max(length, 1e-9);
    for (double s = 0.0; s < length; s += dash + gap) {
      dashes.emplace_back(a + s * along, a + std::min(length, s + dash) * along);
    }
  }
  segments(dashes, thickness, color);
}

void Canvas::polygon(const std::vector<Eigen::Vector2d>& corners, const Color& color) {
  for (const Eigen::Vector2d& corner : corners) {
    if (!corner.allFinite()) return;
  }
  const std::vector<Eigen::Vector2d> clipped =
      clip_polygon(corners, {-8.0, -8.0, width() + 8.0, height() + 8.0});
  if (clipped.size() < 3) return;
  Mask mask(*image_, bounds(clipped, 1.0));
  if (mask.empty()) return;
  std::vector<std::vector<cv::Point>> contours(1);
  for (const Eigen::Vector2d& corner : clipped) {
    contours[0].push_back(fixed_point(mask.local(corner)));
  }
  cv::fillPoly(mask.alpha(), contours, cv::Scalar(255), cv::LINE_AA, kShift);
  mask.blend(*image_, color);
}

void Canvas::rectangle(const Box2& box, const Color& color, double corner_radius) {
  const double r = std::min(corner_radius, 0.5 * std::min(box.width(), box.height()));
  if (r <= 0.0) {
    polygon({{box.x1, box.y1}, {box.x2, box.y1}, {box.x2, box.y2}, {box.x1, box.y2}}, color);
    return;
  }
  std::vector<Eigen::Vector2d> corners;
  const Eigen::Vector2d centers[4] = {{box.x2 - r, box.y2 - r},
                                      {box.x1 + r, box.y2 - r},
                                      {box.x1 + r, box.y1 + r},
                                      {box.x2 - r, box.y1 + r}};
  constexpr int kSteps = 6;
  for (int corner = 0; corner < 4; ++corner) {
    for (int i = 0; i <= kSteps; ++i) {
      const double angle = (corner + static_cast<double>(i) / kSteps) * 0.5 * M_PI;
      corners.emplace_back(centers[corner] + r * Eigen::Vector2d(std::cos(angle), std::sin(angle)));
    }
  }
  polygon(corners, color);
}

void Canvas::disc(const Eigen::Vector2d& center, double radius, const Color& color) {
  if (!center.allFinite()) return;
  const Box2 reach{center.x() - radius, center.y() - radius, center.x() + radius,
                   center.y() + radius};
  Mask mask(*image_, reach.grown(1.0));
  if (mask.empty()) return;
  cv::circle(mask.alpha(), fixed_point(mask.local(center)),
             static_cast<int>(std::lround(radius * kOne)), cv::Scalar(255), cv::FILLED, cv::LINE_AA,
             kShift);
  mask.blend(*image_, color);
}

void Canvas::text(const Eigen::Vector2d& at, const std::string& line, double size,
                  const Color& color, TextAnchor anchor, bool bold) {
  const cv::Mat bitmap = rasterize(line, font_size(size), bold);
  if (bitmap.empty()) return;
  const cv::Point corner = text_corner(at, bitmap, anchor);
  Mask mask(*image_, {1.0 * corner.x, 1.0 * corner.y, 1.0 * corner.x + bitmap.cols,
                      1.0 * corner.y + bitmap.rows});
  if (mask.empty()) return;
  stamp(bitmap, corner.x, corner.y, mask);
  mask.blend(*image_, color);
}

void Canvas::text_with_halo(const Eigen::Vector2d& at, const std::string& line, double size,
                            const Color& color, const Color& halo, TextAnchor anchor, bool bold) {
  const cv::Mat bitmap = rasterize(line, font_size(size), bold);
  if (bitmap.empty()) return;
  const cv::Point corner = text_corner(at, bitmap, anchor);
  const int rim = std::max(1, static_cast<int>(std::lround(size / 9.0)));
  Mask mask(*image_, Box2{1.0 * corner.x, 1.0 * corner.y, 1.0 * corner.x + bitmap.cols,
                          1.0 * corner.y + bitmap.rows}
                         .grown(2.0 * rim));
  if (mask.empty()) return;
  stamp(bitmap, corner.x, corner.y, mask);
  const cv::Mat kernel =
      cv::getStructuringElement(cv::MORPH_ELLIPSE, cv::Size(2 * rim + 1, 2 * rim + 1));
  cv::dilate(mask.alpha(), mask.alpha(), kernel);
  cv::GaussianBlur(mask.alpha(), mask.alpha(), cv::Size(3, 3), 0.0);
  mask.blend(*image_, halo);
  text(at, line, size, color, anchor, bold);
}

void Canvas::text_upwards(const Eigen::Vector2d& at, const std::string& line, double size,
                          const Color& color) {
  cv::Mat bitmap = rasterize(line, font_size(size), false);
  if (bitmap.empty()) return;
  cv::rotate(bitmap, bitmap, cv::ROTATE_90_COUNTERCLOCKWISE);
  const cv::Point corner(static_cast<int>(std::lround(at.x() - 0.5 * bitmap.cols)),
                         static_cast<int>(std::lround(at.y() - 0.5 * bitmap.rows)));
  Mask mask(*image_, {1.0 * corner.x, 1.0 * corner.y, 1.0 * corner.x + bitmap.cols,
                      1.0 * corner.y + bitmap.rows});
  if (mask.empty()) return;
  stamp(bitmap, corner.x, corner.y, mask);
  mask.blend(*image_, color);
}

Eigen::Vector2d Canvas::text_size(const std::string& line, double size, bool bold) {
  const cv::Mat bitmap = rasterize(line, font_size(size), bold);
  return {bitmap.cols, bitmap.rows};
}

}  // namespace camber
