#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace camber::internal {

/// An input or output of a network, as its file declares it.
struct OnnxValue {
  std::string name;
  std::vector<long> shape;  ///< -1: left open by the file
};

/// What an ONNX file states about itself (ModelProto of onnx.proto, ONNX 1.12).
struct OnnxGraph {
  std::string producer;
  std::vector<OnnxValue> inputs;  ///< without weights
  std::vector<OnnxValue> outputs;
  std::map<std::string, std::string> metadata;
};

/// Bytes that are no such file give a graph without inputs and outputs.
OnnxGraph read_onnx_graph(std::string_view onnx);

}  // namespace camber::internal
