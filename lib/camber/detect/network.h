#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "camber/detect/network_description.h"
#include "camber/image/image.h"

namespace camber {

/// An array of numbers, the last index running fastest.
struct Tensor {
  std::vector<int> shape;
  std::vector<float> values;
  std::string name = {};  ///< of an output, as the network's file has it

  std::string describe() const;  ///< "(1, 3549, 85)"
};
/// "output (1, 2, 192, 640) (da) and (1, 2, 192, 640) (ll)"
std::string describe(const std::vector<Tensor>& outputs);

/// A part of an image, whole pixels; may be all of it.
struct ImagePart {
  int x = 0, y = 0, width = 0, height = 0;
};

/// Where the pixels of a part of an image lie in a network's input:
/// input = scale * (pixel - origin), edges of pixels at whole numbers and a half in the image, at
/// whole numbers in the input.
struct InputPlacement {
  double scale_x = 1.0, scale_y = 1.0;    ///< px of the input for one of the image
  double offset_x = 0.0, offset_y = 0.0;  ///< px of the input: the part's left and upper edge
  ImagePart part;

  double to_image_x(double input_x) const { return (input_x - offset_x) / scale_x + part.x - 0.5; }
  double to_image_y(double input_y) const { return (input_y - offset_y) / scale_y + part.y - 0.5; }
};

/// Where a part of an image is put.
InputPlacement place_in_input(const NetworkInput& input, const ImagePart& part);

/// The input that a network takes of a part of an image of 3 channels (bilinear).
/// @throws std::invalid_argument for a part that is empty or not inside the image.
Tensor make_input(const NetworkInput& input, const Image& image, const InputPlacement& at);

/// A made picture of the input's size: channel c (0 red, 1 green, 2 blue) at column x and row y is
/// (x + 2 y + 40 c + 64 ((x / 32 + y / 32) mod 2)) mod 256, divisions rounded down.
Image check_image(const NetworkInput& input);

/// A network that is ready to run.
class Network {
 public:
  virtual ~Network() = default;
  /// Its outputs, ordered by their names. Calls may run side by side; each takes
  /// one thread, and the result depends on the input alone. An input of several images (N, ...)
  /// gives outputs (N, ...) where the network allows it, each image's as if it were alone.
  virtual std::vector<Tensor> run(const Tensor& input) const = 0;
  virtual const std::string& hash() const = 0;  ///< of the file, hash_file()
  /// What was found when it was loaded: "fused" (layers joined by OpenCV), or "unfused", because
  /// joining them changed the outputs.
  virtual const std::string& layers() const = 0;
};

/// A network's file in memory.
struct OnnxFile {
  std::string name;   ///< for messages
  std::string bytes;  ///< ONNX
};
/// @throws InputError if it cannot be read.
OnnxFile read_onnx_file(const std::filesystem::path& path);

/// Loads an ONNX file with OpenCV's DNN, on the CPU; weights of half precision (FLOAT16) become
/// floats. OpenCV joins layers for speed, which corrupts
/// some networks (4.6: TwinLiteNet): the outputs for check_image() with and without it are
/// compared, and also against check.values where there are any; layers are joined only where it
/// changes nothing.
/// It brings many shared libraries: a program can load them when this is first called.
/// @throws InputError for a file that is not ONNX, has operators that OpenCV does not know, takes
///         another input, or does not give the stored outputs.
std::unique_ptr<Network> open_network(OnnxFile file, const NetworkInput& input,
                                      const NetworkCheck& check);

}  // namespace camber
