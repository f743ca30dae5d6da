#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "camber/render/color_map.h"
#include "camber/render/picture_space.h"

class vtkActor;

namespace camber {

/// An actor that VTK counts the owners of, too.
using SharedActor = std::shared_ptr<vtkActor>;

/// A level grid below the content with a round spacing.
struct SceneGrid {
  double z = 0.0;                         ///< m, picture frame
  double x1 = 0, x2 = 0, y1 = 0, y2 = 0;  ///< m, picture frame
  Ticks xs, ys;                           ///< of equal step
};

SceneGrid make_scene_grid(const PictureSpace& space);

struct SceneStyle {
  double line_unit = 1.0;   ///< pixels of a line of width one
  double point_size = 2.0;  ///< pixels
};

/// The actors of one element.
struct SceneLayer {
  SceneElement element;
  std::vector<SharedActor> actors;
};

/// VTK actors of what the content holds, in the picture frame, shown or not: pictures and the
/// viewer are made of the same ones. Elements without content are left out. No GL is needed until
/// they are drawn.
/// @param wanted  asked for each element; empty: all are made.
std::vector<SceneLayer> make_scene_layers(const PictureContent& content, const PictureSpace& space,
                                          const SceneStyle& style,
                                          const std::function<bool(SceneElement)>& wanted = {});

/// Colour of a valid link: plasma over the space's range of height steps.
Color link_color(const PlacedLink& link, const PictureSpace& space);

}  // namespace camber
