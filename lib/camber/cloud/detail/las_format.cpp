#include "camber/cloud/detail/las_format.h"

namespace camber::detail {

LasPointFormat las_point_format(int id) {
  // Sizes and offsets from the tables of the specification.
  static const LasPointFormat kFormats[] = {
      {20, false, -1, -1, -1, -1}, {28, false, 20, -1, -1, -1}, {26, false, -1, 20, -1, -1},
      {34, false, 20, 28, -1, -1}, {57, false, 20, -1, -1, 28}, {63, false, 20, 28, -1, 34},
      {30, true, 22, -1, -1, -1},  {36, true, 22, 30, -1, -1},  {38, true, 22, 30, 36, -1},
      {59, true, 22, -1, -1, 30},  {67, true, 22, 30, 36, 38},
  };
  return kFormats[id];
}

ScalarType las_extra_type(int id) {
  static const ScalarType kTypes[] = {
      ScalarType::kUint8,   ScalarType::kInt8,   ScalarType::kUint16, ScalarType::kInt16,
      ScalarType::kUint32,  ScalarType::kInt32,  ScalarType::kUint64, ScalarType::kInt64,
      ScalarType::kFloat32, ScalarType::kFloat64};
  return kTypes[(id - 1) % 10];
}

}  // namespace camber::detail
