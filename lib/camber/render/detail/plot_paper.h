#pragma once

#include <string>
#include <vector>

#include "camber/render/canvas.h"
#include "camber/render/plot.h"

namespace camber::detail {

inline constexpr Color kPlotInk{40, 40, 40, 1.0};

/// What plots are drawn on: pixels or SVG.
class Paper {
 public:
  virtual ~Paper() = default;
  virtual void segments(const std::vector<Segment2>& lines, double thickness,
                        const Color& color) = 0;
  virtual void polygon(const std::vector<Eigen::Vector2d>& corners, const Color& color) = 0;
  virtual void disc(const Eigen::Vector2d& center, double radius, const Color& color) = 0;
  virtual void picture(const Box2& place, const Image& image) = 0;
  /// @param at    left end, middle or right end of the line, half its height
  virtual void text(const Eigen::Vector2d& at, const std::string& line, double size,
                    TextAnchor anchor, bool bold) = 0;
  virtual void text_upwards(const Eigen::Vector2d& at, const std::string& line, double size) = 0;
};

/// An image.
class PixelPaper : public Paper {
 public:
  explicit PixelPaper(Image& image) : canvas_(image), image_(&image) {}
  void segments(const std::vector<Segment2>& lines, double thickness, const Color& color) override;
  void polygon(const std::vector<Eigen::Vector2d>& corners, const Color& color) override;
  void disc(const Eigen::Vector2d& center, double radius, const Color& color) override;
  void picture(const Box2& place, const Image& image) override;
  void text(const Eigen::Vector2d& at, const std::string& line, double size, TextAnchor anchor,
            bool bold) override;
  void text_upwards(const Eigen::Vector2d& at, const std::string& line, double size) override;

 private:
  Canvas canvas_;
  Image* image_;
};

/// The elements of an SVG drawing.
class SvgPaper : public Paper {
 public:
  std::string body;

  void segments(const std::vector<Segment2>& lines, double thickness, const Color& color) override;
  void polygon(const std::vector<Eigen::Vector2d>& corners, const Color& color) override;
  void disc(const Eigen::Vector2d& center, double radius, const Color& color) override;
  void picture(const Box2& place, const Image& image) override;
  void text(const Eigen::Vector2d& at, const std::string& line, double size, TextAnchor anchor,
            bool bold) override;
  void text_upwards(const Eigen::Vector2d& at, const std::string& line, double size) override;
  /// A clear area of class "hit" with a text for whoever points at it.
  void hover(const Box2& place, const std::string& text);
  /// Nothing to see: what a script needs to find a place of a panel.
  void axes(const PlotAxes& axes);

 private:
  static std::string number(double value);
  static std::string hex(const Color& color);
  static std::string fill(const Color& color);
  /// Canvas draws letters of 0.8 of a line's height.
  static std::string font(double size);
  static std::string escape(const std::string& text);
};

}  // namespace camber::detail
