#include "camber/detect/detail/onnx_graph.h"

#include <algorithm>
#include <set>

#include "camber/detect/detail/protobuf_reader.h"

namespace camber::internal {
namespace {

// Numbers of fields of onnx.proto (ONNX 1.12).
constexpr std::uint64_t kModelProducer = 2, kModelGraph = 7, kModelMetadata = 14;
constexpr std::uint64_t kGraphInitializer = 5, kGraphInput = 11, kGraphOutput = 12;
constexpr std::uint64_t kTensorName = 8, kValueName = 1, kValueType = 2;
constexpr std::uint64_t kTypeTensor = 1, kTensorShape = 2, kShapeDimension = 1, kDimensionValue = 1;
constexpr std::uint64_t kEntryKey = 1, kEntryValue = 2;

template <typename Take>
void for_each_field(std::string_view message, const Take& take) {
  MessageReader reader(message);
  while (const std::optional<Field> field = reader.next()) take(*field);
}

/// Calls for each field of that number that holds bytes.
template <typename Take>
void for_each(std::string_view message, std::uint64_t number, const Take& take) {
  for_each_field(message, [&](const Field& field) {
    if (field.number == number && field.type == kBytes) take(field.bytes);
  });
}

std::string text_of(std::string_view message, std::uint64_t number) {
  std::string out;
  for_each(message, number, [&](std::string_view bytes) { out = bytes; });
  return out;
}

long dimension_of(std::string_view dimension) {
  constexpr std::uint64_t kMost = 1U << 30;
  long out = -1;
  for_each_field(dimension, [&](const Field& field) {
    if (field.number == kDimensionValue && field.type == kVarint && field.varint > 0 &&
        field.varint < kMost) {
      out = static_cast<long>(field.varint);
    }
  });
  return out;
}

OnnxValue value_of(std::string_view message) {
  OnnxValue out;
  out.name = text_of(message, kValueName);
  for_each(message, kValueType, [&](std::string_view type) {
    for_each(type, kTypeTensor, [&](std::string_view tensor) {
      for_each(tensor, kTensorShape, [&](std::string_view shape) {
        for_each(shape, kShapeDimension,
                 [&](std::string_view d) { out.shape.push_back(dimension_of(d)); });
      });
    });
  });
  return out;
}

}  // namespace

OnnxGraph read_onnx_graph(std::string_view onnx) {
  OnnxGraph out;
  out.producer = text_of(onnx, kModelProducer);
  for_each(onnx, kModelMetadata, [&](std::string_view entry) {
    out.metadata[text_of(entry, kEntryKey)] = text_of(entry, kEntryValue);
  });
  for_each(onnx, kModelGraph, [&](std::string_view graph) {
    std::set<std::string> weights;
    for_each_field(graph, [&](const Field& field) {
      if (field.type != kBytes) return;
      if (field.number == kGraphInitializer) weights.insert(text_of(field.bytes, kTensorName));
      if (field.number == kGraphInput) out.inputs.push_back(value_of(field.bytes));
      if (field.number == kGraphOutput) out.outputs.push_back(value_of(field.bytes));
    });
    const auto is_weight = [&](const OnnxValue& v) { return weights.count(v.name) > 0; };
    out.inputs.erase(std::remove_if(out.inputs.begin(), out.inputs.end(), is_weight),
                     out.inputs.end());
  });
  return out;
}

}  // namespace camber::internal
