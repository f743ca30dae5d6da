#include "camber/render/picture_legend.h"

#include <algorithm>
#include <cmath>

namespace camber {
namespace {

double legend_entry_width(const LegendEntry& entry, double text_size) {
  return 2.0 * text_size + Canvas::text_size(entry.text, text_size).x();
}

}  // namespace

std::vector<LegendEntry> make_legend(const PictureSpace& space, const std::string& cameras) {
  std::vector<LegendEntry> entries;
  bool road = false, pavement = false, ground = false, other = false;
  for (const PlacedPatch& patch : space.patches) {
    road |= patch.kind == PatchKind::kRoad;
    pavement |= patch.kind == PatchKind::kPavement;
    ground |= patch.kind == PatchKind::kGround;
    other |= patch.kind == PatchKind::kOther;
  }
  using Mark = LegendEntry::Mark;
  for (const auto& [color, name] : space.classes) entries.push_back({Mark::kDot, color, name});
  if (road) entries.push_back({Mark::kFill, patch_color(PatchKind::kRoad), "road patch"});
  if (pavement) {
    entries.push_back({Mark::kFill, patch_color(PatchKind::kPavement), "pavement patch"});
  }
  if (ground) entries.push_back({Mark::kFill, patch_color(PatchKind::kGround), "ground patch"});
  if (other) entries.push_back({Mark::kFill, patch_color(PatchKind::kOther), "other patch"});
  if (!space.vehicles.empty()) {
    entries.push_back({Mark::kFill, categorical(1), "estimated vehicle"});
  }
  if (!space.truth.empty()) entries.push_back({Mark::kLine, kTruthRed, "true box"});
  if (!space.truth_points.empty()) {
    entries.push_back({Mark::kDot, kTruthGrey, "dense ground truth"});
  }
  if (!space.cameras.empty()) {
    entries.push_back({Mark::kLine, kInk, cameras});
  }
  return entries;
}

int count_legend_rows(double width, const std::vector<LegendEntry>& entries, double text_size) {
  int rows = entries.empty() ? 0 : 1;
  double x = 0.0;
  for (const LegendEntry& entry : entries) {
    const double own = legend_entry_width(entry, text_size);
    if (x > 0.0 && x + own > width) {
      x = 0.0;
      ++rows;
    }
    x += own + 1.1 * text_size;
  }
  return rows;
}

void draw_legend(Canvas& canvas, const Eigen::Vector2d& at, double right_limit,
                 const std::vector<LegendEntry>& entries, double text_size) {
  Eigen::Vector2d cursor = at;
  const double mark = 1.6 * text_size, gap = 1.1 * text_size;
  for (const LegendEntry& entry : entries) {
    const double width = legend_entry_width(entry, text_size);
    if (cursor.x() > at.x() && cursor.x() + width > right_limit) {
      cursor = {at.x(), cursor.y() + 1.3 * text_size};
    }
    const Eigen::Vector2d end = cursor + Eigen::Vector2d(mark, 0.0);
    const Eigen::Vector2d middle = 0.5 * (cursor + end);
    const double thick = std::max(1.5, text_size / 8.0);
    switch (entry.mark) {
      case LegendEntry::Mark::kLine:
        canvas.segments({{cursor, end}}, thick, entry.color);
        break;
      case LegendEntry::Mark::kDashedLine:
        canvas.dashed({{cursor, end}}, 0.35 * text_size, 0.25 * text_size, thick, entry.color);
        break;
      case LegendEntry::Mark::kFill: {
        const Box2 box{cursor.x(), cursor.y() - 0.4 * text_size, end.x(),
                       cursor.y() + 0.4 * text_size};
        canvas.rectangle(box, entry.color.with_alpha(0.35 * entry.color.alpha));
        canvas.polyline({{box.x1, box.y1}, {box.x2, box.y1}, {box.x2, box.y2}, {box.x1, box.y2}},
                        true, 0.7 * thick, entry.color);
        break;
      }
      case LegendEntry::Mark::kDot:
        canvas.disc(middle, 0.28 * text_size, entry.color);
        break;
      case LegendEntry::Mark::kEllipse: {
        std::vector<Eigen::Vector2d> rim;
        for (int i = 0; i < 32; ++i) {
          const double angle = 2.0 * M_PI * i / 32.0;
          rim.push_back(middle + Eigen::Vector2d(0.5 * mark * std::cos(angle),
                                                 0.4 * text_size * std::sin(angle)));
        }
        canvas.polyline(rim, true, 0.8 * thick, entry.color);
        break;
      }
    }
    canvas.text({end.x() + 0.4 * text_size, cursor.y()}, entry.text, text_size, kInk);
    cursor.x() += width + gap;
  }
}

}  // namespace camber
