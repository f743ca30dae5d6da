#include "camber/render/label_layout.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace camber {
namespace {

double shared_area(const Box2& a, const Box2& b) {
  const double w = std::min(a.x2, b.x2) - std::max(a.x1, b.x1);
  const double h = std::min(a.y2, b.y2) - std::max(a.y1, b.y1);
  return w > 0.0 && h > 0.0 ? w * h : 0.0;
}

double distance_between(const Box2& a, const Box2& b) {
  const double dx = std::max({0.0, a.x1 - b.x2, b.x1 - a.x2});
  const double dy = std::max({0.0, a.y1 - b.y2, b.y1 - a.y2});
  return std::hypot(dx, dy);
}

}  // namespace

std::vector<LabelPlace> place_labels(const std::vector<LabelRequest>& requests,
                                     const LabelLayoutOptions& options) {
  std::vector<LabelPlace> places;
  std::vector<Box2> taken = options.taken;
  const Box2& area = options.area;
  for (const LabelRequest& request : requests) {
    LabelPlace place;
    const double w = request.size.x(), h = request.size.y();
    double best = std::numeric_limits<double>::infinity();
    int candidate = 0;
    const auto consider = [&](double x, double y, double penalty) {
      const int number = candidate++;
      // Pushed inside the area rather than dropped; the push is paid for by the distance.
      x = std::clamp(x, area.x1, std::max(area.x1, area.x2 - w));
      y = std::clamp(y, area.y1, std::max(area.y1, area.y2 - h));
      const Box2 box{x, y, x + w, y + h};
      if (box.x2 > area.x2 + 1e-9 || box.y2 > area.y2 + 1e-9) return;
      for (const Box2& other : taken) {
        if (shared_area(box.grown(options.gap), other) > 0.0) return;
      }
      double cost = penalty + 2.0 * distance_between(box, request.target) / h +
                    0.2 * (box.center() - request.target.center()).norm() / h +
                    4.0 * shared_area(box, request.target) / (w * h);
      for (const Box2& other : options.avoid) cost += 6.0 * shared_area(box, other) / (w * h);
      constexpr double kKept = 3.0;  // of cost, for the place of the picture before
      if (number == request.preferred) cost -= kKept;
      if (cost < best) {
        best = cost;
        place = {true, box, false, number};
      }
    };
    const Box2& t = request.target;
    const double cx = t.center().x() - 0.5 * w, cy = t.center().y() - 0.5 * h;
    constexpr int kRings = 6;
    for (int ring = 0; ring < kRings; ++ring) {
      const double off = options.gap + 0.6 * ring * h;
      const double above = t.y1 - off - h, below = t.y2 + off;
      const double left = t.x1 - off - w, right = t.x2 + off;
      for (const double x : {cx, t.x1, t.x2 - w, left, right}) {
        consider(x, above, 0.0);
        consider(x, below, 1.0);
      }
      for (const double y : {cy, t.y1, t.y2 - h}) {
        consider(left, y, 0.5);
        consider(right, y, 0.5);
      }
    }
    if (!place.found) {
      const double step = std::max(2.0, 0.5 * h);
      for (double y = area.y1; y + h <= area.y2; y += step) {
        for (double x = area.x1; x + w <= area.x2; x += step) consider(x, y, 2.0);
      }
      place.candidate = -1;
    }
    if (place.found) {
      place.leader = distance_between(place.box, request.target) > 0.6 * h;
      taken.push_back(place.box);
    }
    places.push_back(place);
  }
  return places;
}

}  // namespace camber
