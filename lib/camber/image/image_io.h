#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/image/image.h"

namespace camber {

/// What an image file's header states.
struct ImageInfo {
  std::string format;    ///< "PNG" or "JPEG"
  int width = 0;         ///< pixels
  int height = 0;        ///< pixels
  int channels = 0;      ///< as stored, alpha included: 1 to 4
  int bits = 0;          ///< per channel
  bool palette = false;  ///< PNG with a palette: one channel of indices
};

/// The header of a PNG or JPEG file. @throws InputError "file: found, expected".
ImageInfo read_image_info(const std::filesystem::path& path);

/// The same of the bytes of such a file. @param name  in messages.
ImageInfo read_image_info(const std::string& bytes, const std::string& name);

/// Decodes a PNG or JPEG image completely: a file that is missing, is no image, is cut off
/// anywhere, or whose checksums do not hold is an error, never a picture with missing rows. Alpha
/// is dropped, 16 bits become 8, a palette becomes colours.
/// @throws InputError "file: found, expected".
Image read_color_image(const std::filesystem::path& path);  ///< 3 channels
Image read_gray_image(const std::filesystem::path& path);   ///< 1 channel, ITU-R BT.601 weights

/// The same of the bytes of a file, 3 channels. @param name  in messages.
Image decode_color_image(const std::string& bytes, const std::string& name);

/// Intensities of a colour image (0.299 R + 0.587 G + 0.114 B, rounded); of a grey one, itself.
Image to_grey(const Image& image);

/// An image of a frame as a run needs it.
struct FrameImage {
  Image color;     ///< 3 channels
  GrayImage gray;  ///< ITU-R BT.601 weights
};

/// Reads a frame's image and checks its size. @throws InputError also where the size differs from
/// the camera's.
FrameImage read_frame_image(const std::filesystem::path& path, const PinholeCamera& camera);

/// A label or mask image: PNG of one channel (or a palette, whose indices are the labels), at most
/// 8 bits, values as stored. @throws InputError also where the size differs from the camera's.
Image read_label_image(const std::filesystem::path& path, const PinholeCamera& camera);

/// The same for any size; of a PNG with more channels or 16 bits the lower byte of the channel with
/// that index is taken. @param channel >= 0.
Image read_label_channel(const std::filesystem::path& path, int channel);

/// Depth truth. "kitti": 16-bit PNG, metres * 256, 0 none. "synthia": 8-bit RGB PNG, metres =
/// (R + 256 G + 65536 B) / (2^24 - 1) * 1000, where 1000 m is none (sky).
/// @throws InputError also for another size than the camera's; std::invalid_argument for another
///         encoding.
DepthImage read_depth_image(const std::filesystem::path& path, const std::string& encoding,
                            const PinholeCamera& camera);

/// KITTI's 16-bit disparity, value / 256 px, 0 none, as depth: z = fx * baseline / disparity.
/// @param baseline m, > 0.
DepthImage read_disparity_image(const std::filesystem::path& path, const PinholeCamera& camera,
                                double baseline);

/// How a PNG file is compressed.
enum class PngCompression {
  kFast,   ///< as suits the picture: a photograph, or a drawing with even areas
  kSmall,  ///< the smaller file for maps of values that change smoothly; ten times the time
};

/// An image as the bytes of a PNG file of 8 bits and 1, 3 or 4 channels. The same pixels give the
/// same bytes.
/// @throws std::invalid_argument for an image that is empty or not as Image requires.
std::string encode_png(const Image& image, PngCompression compression = PngCompression::kFast);

/// 16-bit values, rows from the top, as the bytes of a PNG file of one channel, kSmall.
/// @throws std::invalid_argument for an empty image or another number of values.
std::string encode_png16(int width, int height, const std::vector<std::uint16_t>& values);

/// An image of 3 channels as the bytes of a JPEG file. @param quality  1 to 100.
/// @throws std::invalid_argument as encode_png().
std::string encode_jpeg(const Image& image, int quality = 90);

/// Writes encode_png(), atomically. @throws OutputError, and as encode_png().
void write_png(const Image& image, const std::filesystem::path& path);

}  // namespace camber
