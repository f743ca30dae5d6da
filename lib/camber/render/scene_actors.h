#pragma once

#include <vtkActor.h>
#include <vtkSmartPointer.h>

#include <functional>
#include <vector>

#include "camber/render/color_map.h"
#include "camber/render/picture_space.h"

namespace camber {

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

/// The actors of one element; translucent ones report so.
struct SceneLayer {
  SceneElement element;
  std::vector<vtkSmartPointer<vtkActor>> actors;
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

/// Only the road points, with the space's colours.
vtkSmartPointer<vtkActor> make_points_actor(const PictureSpace& space, double pixels);

}  // namespace camber
