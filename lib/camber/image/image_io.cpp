#include "camber/image/image_io.h"

#include <fmt/format.h>
#include <png.h>

#include <algorithm>
#include <cmath>
#include <csetjmp>
#include <cstdio>
#include <cstring>
#include <limits>
#include <new>
#include <stdexcept>

// jpeglib.h needs size_t and FILE before it.
#include <jerror.h>
#include <jpeglib.h>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/read_file.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr int kMaxSide = 65535;
constexpr std::int64_t kMaxPixels = 1 << 28;
constexpr std::size_t kMaxFileBytes = std::size_t{1} << 30;

/// Samples of an image as it was stored, after the transformations that were asked for.
struct Decoded {
  int width = 0, height = 0, channels = 0, bits = 8;
  std::vector<std::uint8_t> data;  // 16-bit samples are big endian
};

enum class Want {
  kHeader,   // the sizes alone
  kRaw,      // samples as stored; palette indices; 1, 2 and 4 bits widened to 8 without scaling
  kColors8,  // 1 or 3 channels of 8 bits
};

bool is_png(const std::string& bytes) {
  return bytes.size() >= 8 && std::memcmp(bytes.data(), "\x89PNG\r\n\x1a\n", 8) == 0;
}

bool is_jpeg(const std::string& bytes) {
  return bytes.size() >= 3 && std::memcmp(bytes.data(), "\xff\xd8\xff", 3) == 0;
}

/// Refuses sizes that the file cannot possibly hold, before memory is taken. Deflate packs at most
/// 1032 to 1, JPEG's smallest 8 x 8 block takes a few bits.
bool plausible_size(double width, double height, double channels, std::size_t file_bytes) {
  return width * height * channels <= 1100.0 * static_cast<double>(file_bytes) + 65536.0;
}

// ---- PNG ----------------------------------------------------------------------------------------

struct PngSource {
  const std::uint8_t* bytes = nullptr;
  std::size_t size = 0;
  std::size_t position = 0;
  std::jmp_buf jump;
  char message[160] = {0};
};

void png_fail(png_structp png, png_const_charp message) {
  auto* source = static_cast<PngSource*>(png_get_error_ptr(png));
  std::snprintf(source->message, sizeof(source->message), "%s", message);
  std::longjmp(source->jump, 1);
}

void png_ignore_warning(png_structp, png_const_charp) {}

void png_take(png_structp png, png_bytep out, png_size_t count) {
  auto* source = static_cast<PngSource*>(png_get_io_ptr(png));
  if (source->size - source->position < count) {
    png_error(png, "the file ends too early");
  }
  std::memcpy(out, source->bytes + source->position, count);
  source->position += count;
}

/// Reads up to the pixels, which `rows` takes; nothing with a destructor lives across a jump.
bool png_header(png_structp png, png_infop info, PngSource* source, Want want, ImageInfo* image,
                int* channels, int* bits, std::size_t* row_bytes) {
  if (setjmp(source->jump)) return false;
  png_set_user_limits(png, kMaxSide, kMaxSide);
  png_set_crc_action(png, PNG_CRC_ERROR_QUIT, PNG_CRC_WARN_DISCARD);
  png_set_read_fn(png, source, png_take);
  png_read_info(png, info);
  image->width = static_cast<int>(png_get_image_width(png, info));
  image->height = static_cast<int>(png_get_image_height(png, info));
  image->channels = png_get_channels(png, info);
  image->bits = png_get_bit_depth(png, info);
  image->palette = png_get_color_type(png, info) == PNG_COLOR_TYPE_PALETTE;
  if (want == Want::kHeader) return true;
  if (want == Want::kRaw) {
    png_set_packing(png);
  } else {
    png_set_expand(png);
    png_set_scale_16(png);
    png_set_strip_alpha(png);
  }
  png_set_interlace_handling(png);
  png_read_update_info(png, info);
  *channels = png_get_channels(png, info);
  *bits = std::max<int>(8, png_get_bit_depth(png, info));
  *row_bytes = png_get_rowbytes(png, info);
  return true;
}

bool png_pixels(png_structp png, PngSource* source, png_bytep* rows) {
  if (setjmp(source->jump)) return false;
  png_read_image(png, rows);
  png_read_end(png, nullptr);  // up to IEND, checksums included
  return true;
}

/// libpng's sentences in ours: what was found.
std::string png_reason(const PngSource& source) {
  const std::string message = source.message;
  if (message.find("ends too early") != std::string::npos ||
      message.find("Not enough image data") != std::string::npos) {
    return fmt::format("found a truncated PNG image of {} bytes", source.size);
  }
  return fmt::format("found a damaged PNG image near byte {} ({})", source.position,
                     printable(message, 100));
}

/// A small file may unpack to gigabytes of one colour.
void check_pixels(const Decoded& image, const std::string& name) {
  if (static_cast<std::int64_t>(image.width) * image.height <= kMaxPixels) return;
  throw InputError(name, fmt::format("found {} x {} pixels, expected at most {} in all",
                                     image.width, image.height, kMaxPixels));
}

/// Cameras of 10 and 12 bits write them into 16 as they are: as bytes they would be a few levels.
void check_16bit(const Decoded& as_bytes, const std::string& name) {
  constexpr std::uint8_t kMost = 16;  // of 12 bits
  const auto largest = as_bytes.data.empty()
                           ? std::uint8_t{0}
                           : *std::max_element(as_bytes.data.begin(), as_bytes.data.end());
  if (largest == 0 || largest > kMost) return;
  const int used = 8 + static_cast<int>(std::ceil(std::log2(largest)));
  throw InputError(name, fmt::format("found 16-bit samples that use the lower {} bits alone, "
                                     "expected values that fill 16 bits: multiply them by {}",
                                     used, 1 << (16 - used)));
}

Decoded decode_png(const std::string& bytes, const std::string& name, Want want, ImageInfo* image) {
  PngSource source;
  source.bytes = reinterpret_cast<const std::uint8_t*>(bytes.data());
  source.size = bytes.size();
  png_structp png =
      png_create_read_struct(PNG_LIBPNG_VER_STRING, &source, png_fail, png_ignore_warning);
  png_infop info = png ? png_create_info_struct(png) : nullptr;
  struct Guard {
    png_structp* png;
    png_infop* info;
    ~Guard() { png_destroy_read_struct(png, info, nullptr); }
  } guard{&png, &info};
  if (!png || !info) throw std::bad_alloc();

  Decoded out;
  std::size_t row_bytes = 0;
  const auto fail = [&]() {
    throw InputError(name, png_reason(source) + ", expected a complete image");
  };
  if (!png_header(png, info, &source, want, image, &out.channels, &out.bits, &row_bytes)) fail();
  image->format = "PNG";
  out.width = image->width;
  out.height = image->height;
  if (want == Want::kHeader) return out;
  // 1 bit a pixel may become 3 bytes.
  if (!plausible_size(image->width, image->height, image->channels * image->bits / 8.0,
                      bytes.size())) {
    throw InputError(name,
                     fmt::format("found a PNG header that promises {} x {} pixels in a file of "
                                 "{} bytes, expected a complete image",
                                 image->width, image->height, bytes.size()));
  }
  check_pixels(out, name);
  out.data.resize(row_bytes * static_cast<std::size_t>(out.height));
  std::vector<png_bytep> rows(static_cast<std::size_t>(out.height));
  for (std::size_t y = 0; y < rows.size(); ++y) rows[y] = out.data.data() + y * row_bytes;
  if (!png_pixels(png, &source, rows.data())) fail();
  if (want == Want::kColors8 && image->bits == 16) check_16bit(out, name);
  return out;
}

// ---- JPEG ---------------------------------------------------------------------------------------

struct JpegErrors {
  jpeg_error_mgr base;  // first: libjpeg hands back a pointer to it
  std::jmp_buf jump;
  char message[JMSG_LENGTH_MAX] = {0};
};

void jpeg_fail(j_common_ptr jpeg) {
  auto* errors = reinterpret_cast<JpegErrors*>(jpeg->err);
  jpeg->err->format_message(jpeg, errors->message);
  std::longjmp(errors->jump, 1);
}

/// Damage that the decoder would paint over is refused; stray bytes between markers and the like
/// are harmless.
void jpeg_emit(j_common_ptr jpeg, int level) {
  if (level >= 0) return;
  switch (jpeg->err->msg_code) {
    case JWRN_JPEG_EOF:
    case JWRN_HIT_MARKER:
    case JWRN_HUFF_BAD_CODE:
    case JWRN_MUST_RESYNC:
      jpeg_fail(jpeg);
  }
}

void jpeg_silent(j_common_ptr) {}

bool jpeg_header(jpeg_decompress_struct* jpeg, JpegErrors* errors, const std::string* bytes) {
  if (setjmp(errors->jump)) return false;
  jpeg_create_decompress(jpeg);
  jpeg_mem_src(jpeg, reinterpret_cast<const unsigned char*>(bytes->data()), bytes->size());
  jpeg_read_header(jpeg, TRUE);
  return true;
}

bool jpeg_start(jpeg_decompress_struct* jpeg, JpegErrors* errors) {
  if (setjmp(errors->jump)) return false;
  jpeg->out_color_space = jpeg->jpeg_color_space == JCS_GRAYSCALE ? JCS_GRAYSCALE : JCS_RGB;
  jpeg_start_decompress(jpeg);
  return true;
}

bool jpeg_pixels(jpeg_decompress_struct* jpeg, JpegErrors* errors, std::uint8_t* data,
                 std::size_t row_bytes) {
  if (setjmp(errors->jump)) return false;
  while (jpeg->output_scanline < jpeg->output_height) {
    JSAMPROW row = data + row_bytes * jpeg->output_scanline;
    jpeg_read_scanlines(jpeg, &row, 1);
  }
  jpeg_finish_decompress(jpeg);
  return true;
}

Decoded decode_jpeg(const std::string& bytes, const std::string& name, Want want,
                    ImageInfo* image) {
  JpegErrors errors;
  jpeg_decompress_struct jpeg;
  std::memset(&jpeg, 0, sizeof(jpeg));
  jpeg.err = jpeg_std_error(&errors.base);
  errors.base.error_exit = jpeg_fail;
  errors.base.emit_message = jpeg_emit;
  errors.base.output_message = jpeg_silent;
  struct Guard {
    jpeg_decompress_struct* jpeg;
    ~Guard() { jpeg_destroy_decompress(jpeg); }
  } guard{&jpeg};
  const auto fail = [&]() {
    const std::string message = errors.message;
    const bool cut = message.find("remature end") != std::string::npos;
    throw InputError(
        name, (cut ? fmt::format("found a truncated JPEG image of {} bytes", bytes.size())
                   : fmt::format("found a damaged JPEG image ({})", printable(message, 100))) +
                  ", expected a complete image");
  };

  Decoded out;
  if (!jpeg_header(&jpeg, &errors, &bytes)) fail();
  image->format = "JPEG";
  image->width = static_cast<int>(jpeg.image_width);
  image->height = static_cast<int>(jpeg.image_height);
  image->channels = jpeg.num_components;
  image->bits = 8;
  out.width = image->width;
  out.height = image->height;
  if (want == Want::kHeader) return out;
  if (jpeg.num_components != 1 && jpeg.num_components != 3) {
    throw InputError(name, fmt::format("found a JPEG image of {} channels, expected 1 or 3",
                                       jpeg.num_components));
  }
  if (!plausible_size(out.width, out.height, image->channels, bytes.size())) {
    throw InputError(name, fmt::format("found a JPEG header that promises {} x {} pixels in a file "
                                       "of {} bytes, expected a complete image",
                                       out.width, out.height, bytes.size()));
  }
  check_pixels(out, name);
  if (!jpeg_start(&jpeg, &errors)) fail();
  out.channels = jpeg.output_components;
  const std::size_t row_bytes = static_cast<std::size_t>(out.width) * out.channels;
  out.data.resize(row_bytes * static_cast<std::size_t>(out.height));
  if (!jpeg_pixels(&jpeg, &errors, out.data.data(), row_bytes)) fail();
  return out;
}

// -------------------------------------------------------------------------------------------------

Decoded decode(const std::string& bytes, const std::string& name, Want want, ImageInfo* image) {
  if (is_png(bytes)) return decode_png(bytes, name, want, image);
  if (is_jpeg(bytes)) return decode_jpeg(bytes, name, want, image);
  throw InputError(name, bytes.empty() ? "found an empty file, expected a PNG or JPEG image"
                                       : "found a file that is neither PNG nor JPEG, expected an "
                                         "image");
}

Decoded decode(const fs::path& path, Want want, ImageInfo* image) {
  return decode(read_whole_file(path, kMaxFileBytes), path.string(), want, image);
}

void check_size(const fs::path& path, int width, int height, const PinholeCamera& camera) {
  if (width == camera.width && height == camera.height) return;
  throw InputError(path.string(),
                   fmt::format("found an image of {} x {} pixels, expected the camera's {} x {}",
                               width, height, camera.width, camera.height));
}

Image replicate(const Image& grey) {
  Image out{grey.width, grey.height, 3, {}};
  out.data.resize(grey.data.size() * 3);
  for (std::size_t i = 0; i < grey.data.size(); ++i) {
    out.data[3 * i] = out.data[3 * i + 1] = out.data[3 * i + 2] = grey.data[i];
  }
  return out;
}

Image read_8bit(const fs::path& path) {
  ImageInfo info;
  Decoded decoded = decode(path, Want::kColors8, &info);
  return {decoded.width, decoded.height, decoded.channels, std::move(decoded.data)};
}

/// 16-bit values of a one-channel PNG.
std::vector<std::uint16_t> read_16bit(const fs::path& path, const PinholeCamera& camera,
                                      const char* expectation) {
  ImageInfo info;
  const Decoded decoded = decode(path, Want::kRaw, &info);
  if (info.format != "PNG" || info.channels != 1 || info.bits != 16) {
    throw InputError(path.string(),
                     fmt::format("found a {} of {} channel(s) of {} bits, expected {}", info.format,
                                 info.channels, info.bits, expectation));
  }
  check_size(path, decoded.width, decoded.height, camera);
  std::vector<std::uint16_t> out(decoded.data.size() / 2);
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = static_cast<std::uint16_t>(decoded.data[2 * i] << 8 | decoded.data[2 * i + 1]);
  }
  return out;
}

constexpr float kNoDepth = std::numeric_limits<float>::quiet_NaN();

}  // namespace

ImageInfo read_image_info(const fs::path& path) {
  ImageInfo info;
  decode(path, Want::kHeader, &info);
  return info;
}

ImageInfo read_image_info(const std::string& bytes, const std::string& name) {
  ImageInfo info;
  decode(bytes, name, Want::kHeader, &info);
  return info;
}

Image decode_color_image(const std::string& bytes, const std::string& name) {
  ImageInfo info;
  Decoded decoded = decode(bytes, name, Want::kColors8, &info);
  Image image{decoded.width, decoded.height, decoded.channels, std::move(decoded.data)};
  return image.channels == 1 ? replicate(image) : image;
}

Image to_grey(const Image& image) {
  if (image.channels == 1) return image;
  if (image.channels != 3) {
    throw std::invalid_argument(
        fmt::format("to_grey: image has {} channels, expected 1 or 3", image.channels));
  }
  Image out{image.width, image.height, 1, {}};
  out.data.resize(image.data.size() / 3);
  const std::uint8_t* from = image.data.data();
  for (std::size_t i = 0; i < out.data.size(); ++i, from += 3) {
    // 15-bit weights that sum to 1.
    out.data[i] = static_cast<std::uint8_t>(
        (9798u * from[0] + 19235u * from[1] + 3735u * from[2] + (1u << 14)) >> 15);
  }
  return out;
}

Image read_color_image(const fs::path& path) {
  Image image = read_8bit(path);
  return image.channels == 1 ? replicate(image) : image;
}

Image read_gray_image(const fs::path& path) { return to_grey(read_8bit(path)); }

FrameImage read_frame_image(const fs::path& path, const PinholeCamera& camera) {
  FrameImage out;
  Image image = read_8bit(path);
  check_size(path, image.width, image.height, camera);
  Image gray = to_grey(image);
  out.gray = {gray.width, gray.height, std::move(gray.data)};
  out.color = image.channels == 1 ? replicate(image) : std::move(image);
  return out;
}

Image read_label_image(const fs::path& path, const PinholeCamera& camera) {
  ImageInfo info;
  Decoded decoded = decode(path, Want::kRaw, &info);
  if (info.format != "PNG" || info.channels != 1 || info.bits > 8) {
    throw InputError(path.string(),
                     fmt::format("found a {} of {} channel(s) of {} bits, expected a PNG of one "
                                 "channel of 8 bits",
                                 info.format, info.channels, info.bits));
  }
  check_size(path, decoded.width, decoded.height, camera);
  return {decoded.width, decoded.height, 1, std::move(decoded.data)};
}

Image read_label_channel(const fs::path& path, int channel) {
  ImageInfo info;
  const Decoded decoded = decode(path, Want::kRaw, &info);
  if (info.format != "PNG" || channel < 0 || channel >= decoded.channels) {
    throw InputError(path.string(),
                     fmt::format("found a {} of {} channel(s), expected a PNG with a "
                                 "channel {}",
                                 info.format, info.channels, channel));
  }
  Image out{decoded.width, decoded.height, 1, {}};
  const std::size_t sample = decoded.bits / 8;
  const std::size_t step = sample * static_cast<std::size_t>(decoded.channels);
  const std::size_t first = static_cast<std::size_t>(channel) * sample + (sample - 1);
  out.data.resize(static_cast<std::size_t>(out.width) * out.height);
  for (std::size_t i = 0; i < out.data.size(); ++i) out.data[i] = decoded.data[i * step + first];
  return out;
}

DepthImage read_depth_image(const fs::path& path, const std::string& encoding,
                            const PinholeCamera& camera) {
  DepthImage out{camera.width, camera.height, {}};
  if (encoding == "kitti") {
    const std::vector<std::uint16_t> values =
        read_16bit(path, camera, "a PNG of one channel of 16 bits (metres * 256)");
    out.metres.reserve(values.size());
    for (const std::uint16_t v : values) {
      out.metres.push_back(v == 0 ? kNoDepth : static_cast<float>(v) / 256.0f);
    }
    return out;
  }
  if (encoding != "synthia") {
    throw std::invalid_argument("depth encoding '" + encoding + "', expected kitti or synthia");
  }
  ImageInfo info;
  const Decoded decoded = decode(path, Want::kRaw, &info);
  if (info.format != "PNG" || info.channels < 3 || info.bits != 8 || info.palette) {
    throw InputError(path.string(),
                     fmt::format("found a {} of {} channel(s) of {} bits, expected a PNG of red, "
                                 "green and blue of 8 bits (24-bit depth)",
                                 info.format, info.channels, info.bits));
  }
  check_size(path, decoded.width, decoded.height, camera);
  constexpr std::uint32_t kNone = (1u << 24) - 1;
  const std::size_t count = static_cast<std::size_t>(decoded.width) * decoded.height;
  out.metres.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint8_t* p = decoded.data.data() + i * static_cast<std::size_t>(decoded.channels);
    const std::uint32_t value = p[0] | (std::uint32_t{p[1]} << 8) | (std::uint32_t{p[2]} << 16);
    out.metres[i] =
        value >= kNone ? kNoDepth : static_cast<float>(static_cast<double>(value) / kNone * 1000.0);
  }
  return out;
}

DepthImage read_disparity_image(const fs::path& path, const PinholeCamera& camera,
                                double baseline) {
  if (!(baseline > 0.0) || !std::isfinite(baseline)) {
    throw std::invalid_argument(fmt::format("baseline {}, expected a positive number", baseline));
  }
  const std::vector<std::uint16_t> values =
      read_16bit(path, camera, "a PNG of one channel of 16 bits (disparity * 256)");
  DepthImage out{camera.width, camera.height, {}};
  out.metres.reserve(values.size());
  for (const std::uint16_t v : values) {
    out.metres.push_back(v == 0 ? kNoDepth : static_cast<float>(camera.fx * baseline * 256.0 / v));
  }
  return out;
}

}  // namespace camber
