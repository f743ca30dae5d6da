#include "camber/synth/detail/ground_objects.h"

namespace camber {
namespace {

SurfaceKind surface_of(GroundKind kind) {
  switch (kind) {
    case GroundKind::kRoad:
      return SurfaceKind::kAsphalt;
    case GroundKind::kKerb:
      return SurfaceKind::kKerb;
    case GroundKind::kPavement:
      return SurfaceKind::kPavement;
    case GroundKind::kPad:
      return SurfaceKind::kPad;
    case GroundKind::kVerge:
      break;
  }
  return SurfaceKind::kGrass;
}

TruthLabel label_of(GroundKind kind) {
  switch (kind) {
    case GroundKind::kRoad:
      return TruthLabel::kRoad;
    case GroundKind::kKerb:
    case GroundKind::kPavement:
    case GroundKind::kPad:
      return TruthLabel::kPavement;
    case GroundKind::kVerge:
      break;
  }
  return TruthLabel::kTerrain;
}

}  // namespace

SynthObject asphalt_object(double half_width, float contrast, bool marked, std::uint32_t seed) {
  SynthObject object;
  object.kind = SurfaceKind::kAsphalt;
  object.label = TruthLabel::kRoad;
  object.seed = seed;
  object.extent = {static_cast<float>(half_width), contrast, marked ? 1.0f : 0.0f, 0.0f};
  return object;
}

GroundObjects::GroundObjects(double half_width, std::uint32_t seed, float contrast,
                             MeshBuilder* builder) {
  for (const GroundKind kind : {GroundKind::kRoad, GroundKind::kKerb, GroundKind::kPavement,
                                GroundKind::kPad, GroundKind::kVerge}) {
    SynthObject object = asphalt_object(half_width, contrast, true, seed);
    object.kind = surface_of(kind);
    object.label = label_of(kind);
    objects_[static_cast<std::size_t>(kind)] = builder->add_object(object);
  }
}

}  // namespace camber
