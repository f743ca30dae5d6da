#include "camber/detect/shipped_networks.h"

// The bytes of the files: an array of numbers in C++ would take the compiler minutes.
#define CAMBER_EMBED(symbol, file)                                              \
  __asm__(                                                                      \
      ".pushsection .rodata\n"                                                  \
      ".balign 16\n"                                                            \
      ".local " #symbol                                                         \
      "_begin\n"                                                                \
      ".local " #symbol "_end\n" #symbol                                        \
      "_begin:\n"                                                               \
      ".incbin \"" file "\"\n" #symbol                                          \
      "_end:\n"                                                                 \
      ".popsection\n");                                                         \
  extern "C" __attribute__((visibility("hidden"))) const char symbol##_begin[]; \
  extern "C" __attribute__((visibility("hidden"))) const char symbol##_end[]

CAMBER_EMBED(camber_keypoints_onnx, CAMBER_MODELS "/keypoints.onnx");
CAMBER_EMBED(camber_keypoints_json, CAMBER_MODELS "/keypoints.json");
CAMBER_EMBED(camber_vehicles_onnx, CAMBER_MODELS "/vehicles.onnx");
CAMBER_EMBED(camber_vehicles_json, CAMBER_MODELS "/vehicles.json");

namespace camber {

OnnxFile shipped_keypoint_network() {
  return {"the keypoint network that ships",
          std::string(camber_keypoints_onnx_begin, camber_keypoints_onnx_end)};
}

std::string shipped_keypoint_description() {
  return std::string(camber_keypoints_json_begin, camber_keypoints_json_end);
}

OnnxFile shipped_detector() {
  return {"the detector that ships",
          std::string(camber_vehicles_onnx_begin, camber_vehicles_onnx_end)};
}

std::string shipped_detector_description() {
  return std::string(camber_vehicles_json_begin, camber_vehicles_json_end);
}

}  // namespace camber
