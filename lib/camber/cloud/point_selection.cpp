#include "camber/cloud/point_selection.h"

#include <algorithm>
#include <array>

#include "camber/cloud/las_names.h"
#include "camber/cloud/stream_filters.h"
#include "camber/core/errors.h"

namespace camber {
namespace {

std::size_t field_of(const PointStreamHeader& header, const char* wanted, const std::string& name) {
  for (const bool exact : {true, false}) {
    for (std::size_t f = 0; f < header.fields.size(); ++f) {
      const std::string& own = header.fields[f].name;
      if (exact ? own == wanted : las_attribute(own) == wanted) return f;
    }
  }
  throw InputError(name, std::string("found no attribute '") + wanted + "', expected one");
}

/// 1 for each class that stays.
std::array<unsigned char, 256> kept_classes(const PointSelection& selection) {
  std::array<unsigned char, 256> keep;
  keep.fill(selection.classes.empty() ? 1 : 0);
  for (const int c : selection.classes) keep.at(static_cast<std::size_t>(c)) = 1;
  for (const int c : selection.without_classes) keep.at(static_cast<std::size_t>(c)) = 0;
  return keep;
}

bool returns_fit(PointSelection::Returns wanted, double number, double count) {
  switch (wanted) {
    case PointSelection::Returns::kFirst:
      return number <= 1.0;
    case PointSelection::Returns::kLast:
      return number >= count;
    case PointSelection::Returns::kSingle:
      return count <= 1.0;
    case PointSelection::Returns::kAll:
      break;
  }
  return true;
}

}  // namespace

bool inside_rings(const PlanRings& rings, const Eigen::Vector2d& place) {
  // Crossings of the ray to the right; an edge holds its lower end alone (Shimrat, CACM 1962).
  bool inside = false;
  for (const std::vector<Eigen::Vector2d>& ring : rings) {
    for (std::size_t i = 0, j = ring.size() - 1; i < ring.size(); j = i++) {
      const Eigen::Vector2d &a = ring[i], &b = ring[j];
      if ((a.y() > place.y()) == (b.y() > place.y())) continue;
      // The same edge gives the same crossing from both sides: its lower end first.
      const Eigen::Vector2d &low = a.y() < b.y() ? a : b, &high = a.y() < b.y() ? b : a;
      const double x =
          low.x() + (high.x() - low.x()) * ((place.y() - low.y()) / (high.y() - low.y()));
      if (place.x() < x) inside = !inside;
    }
  }
  return inside;
}

std::unique_ptr<PointSource> select_points(std::unique_ptr<PointSource> source,
                                           const PointSelection& selection,
                                           const std::string& name) {
  const PointStreamHeader& header = source->header();
  const bool by_class = !selection.classes.empty() || !selection.without_classes.empty();
  const bool by_return = selection.returns != PointSelection::Returns::kAll;
  const std::size_t class_field = by_class ? field_of(header, "classification", name) : 0;
  const std::size_t number_field = by_return ? field_of(header, "return_number", name) : 0;
  const std::size_t count_field = by_return ? field_of(header, "number_of_returns", name) : 0;
  const std::array<unsigned char, 256> keep_class = kept_classes(selection);
  const bool any_class = selection.classes.empty();
  const std::array<int, 3> position = find_roles(header.fields).position;
  Eigen::AlignedBox2d extent;
  for (const std::vector<Eigen::Vector2d>& ring : selection.area) {
    for (const Eigen::Vector2d& corner : ring) extent.extend(corner);
  }
  return select_rows(std::move(source), [=](const PointStreamHeader& head, const PointBatch& batch,
                                            std::vector<unsigned char>* keep) {
    const auto value = [&](std::size_t field, std::size_t i) {
      return batch.fields[field].number(head.fields[field].type, i);
    };
    for (std::size_t i = 0; i < batch.count; ++i) {
      bool stays = true;
      if (by_class) {
        const double number = value(class_field, i);
        const bool known = number >= 0.0 && number <= 255.0;
        stays = known ? keep_class[static_cast<std::size_t>(number)] != 0 : any_class;
      }
      if (stays && by_return) {
        stays = returns_fit(selection.returns, value(number_field, i), value(count_field, i));
      }
      if (stays && !selection.area.empty()) {
        const Eigen::Vector2d place(value(static_cast<std::size_t>(position[0]), i),
                                    value(static_cast<std::size_t>(position[1]), i));
        stays = extent.contains(place) && inside_rings(selection.area, place);
      }
      if (!stays) (*keep)[i] = 0;
    }
  });
}

}  // namespace camber
