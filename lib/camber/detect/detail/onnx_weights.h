#pragma once

#include <string>

namespace camber {

/// An ONNX file whose weights of half precision (graph.initializer, TensorProto of FLOAT16) are
/// floats, since OpenCV 4.6 refuses others. Bytes that are no such file are returned as they are.
std::string half_weights_to_floats(std::string onnx);

}  // namespace camber
