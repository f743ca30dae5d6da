#include <fmt/format.h>
#include <png.h>
#include <zlib.h>

#include <csetjmp>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>
#include <stdexcept>

#include <jpeglib.h>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/image/image_io.h"

namespace camber {
namespace {

constexpr int kMaxSide = 65535;

bool is_sound(const Image& image) {
  return image.width > 0 && image.height > 0 && image.width <= kMaxSide &&
         image.height <= kMaxSide &&
         image.data.size() == static_cast<std::size_t>(image.width) * image.height *
                                  static_cast<std::size_t>(image.channels);
}

void require_sound(const Image& image, bool channels, const char* function, const char* expected) {
  if (channels && is_sound(image)) return;
  throw std::invalid_argument(fmt::format(
      "{}: image of {} x {} x {} with {} bytes, expected {} channels and a byte for "
      "each sample",
      function, image.width, image.height, image.channels, image.data.size(), expected));
}

struct PngSink {
  std::string bytes;
  std::jmp_buf jump;
};

void png_sink_fail(png_structp png, png_const_charp) {
  std::longjmp(static_cast<PngSink*>(png_get_error_ptr(png))->jump, 1);
}
void png_no_warning(png_structp, png_const_charp) {}
void png_put(png_structp png, png_bytep data, png_size_t count) {
  auto* sink = static_cast<PngSink*>(png_get_io_ptr(png));
  sink->bytes.append(reinterpret_cast<const char*>(data), count);
}
void png_flush_nothing(png_structp) {}

/// A row filter, and how zlib packs the filtered rows.
struct PngMethod {
  int filter = PNG_ALL_FILTERS, level = 6, strategy = Z_FILTERED;
};
constexpr PngMethod kSmoothMap{};
/// Filtered rows of noise have no repetitions to look for, only frequent values.
constexpr PngMethod kPhotograph{PNG_FILTER_PAETH, 1, Z_RLE};
constexpr PngMethod kDrawing{PNG_FILTER_NONE, 6, Z_DEFAULT_STRATEGY};

struct PngLayout {
  int width = 0, height = 0, bits = 8, color = PNG_COLOR_TYPE_RGB;
  PngMethod method;
  const std::uint8_t* rows = nullptr;
  std::size_t row_bytes = 0;
};

/// Whether few pixels equal their neighbour, by every eighth row: photographs 1 to 8 %, drawings
/// and maps of labels 86 to 100 %.
bool is_photograph(const Image& image) {
  constexpr int kRowStep = 8, kMostEqual = 3;  // in ten
  const auto channels = static_cast<std::size_t>(image.channels);
  std::size_t equal = 0, pixels = 0;
  for (int y = 0; y < image.height; y += kRowStep) {
    const std::uint8_t* row = image.row(y);
    for (int x = 1; x < image.width; ++x, row += channels, ++pixels) {
      if (std::memcmp(row, row + channels, channels) == 0) ++equal;
    }
  }
  return 10 * equal < kMostEqual * pixels;
}

bool put_png(png_structp png, png_infop info, PngSink* sink, const PngLayout* image) {
  if (setjmp(sink->jump)) return false;
  png_set_write_fn(png, sink, png_put, png_flush_nothing);
  png_set_filter(png, PNG_FILTER_TYPE_BASE, image->method.filter);
  png_set_compression_level(png, image->method.level);
  png_set_compression_strategy(png, image->method.strategy);
  png_set_IHDR(png, info, static_cast<png_uint_32>(image->width),
               static_cast<png_uint_32>(image->height), image->bits, image->color,
               PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, info);
  for (int y = 0; y < image->height; ++y) {
    png_write_row(png, image->rows + image->row_bytes * static_cast<std::size_t>(y));
  }
  png_write_end(png, nullptr);
  return true;
}

std::string encode(const PngLayout& image) {
  PngSink sink;
  png_structp png =
      png_create_write_struct(PNG_LIBPNG_VER_STRING, &sink, png_sink_fail, png_no_warning);
  png_infop info = png ? png_create_info_struct(png) : nullptr;
  struct Guard {
    png_structp* png;
    png_infop* info;
    ~Guard() { png_destroy_write_struct(png, info); }
  } guard{&png, &info};
  // The sink takes everything and the image is sound.
  if (!png || !info || !put_png(png, info, &sink, &image)) throw std::bad_alloc();
  return std::move(sink.bytes);
}

struct JpegSink {
  jpeg_error_mgr base;  // first: the library hands back a pointer to it
  std::jmp_buf jump;
  unsigned char* bytes = nullptr;
  unsigned long size = 0;  // NOLINT(google-runtime-int): libjpeg's type
};

void jpeg_sink_fail(j_common_ptr jpeg) {
  std::longjmp(reinterpret_cast<JpegSink*>(jpeg->err)->jump, 1);
}

bool put_jpeg(jpeg_compress_struct* jpeg, JpegSink* sink, const Image* image, int quality) {
  if (setjmp(sink->jump)) return false;
  jpeg_create_compress(jpeg);
  jpeg_mem_dest(jpeg, &sink->bytes, &sink->size);
  jpeg->image_width = static_cast<JDIMENSION>(image->width);
  jpeg->image_height = static_cast<JDIMENSION>(image->height);
  jpeg->input_components = 3;
  jpeg->in_color_space = JCS_RGB;
  jpeg_set_defaults(jpeg);
  jpeg_set_quality(jpeg, quality, TRUE);
  jpeg_start_compress(jpeg, TRUE);
  while (jpeg->next_scanline < jpeg->image_height) {
    auto* row = const_cast<JSAMPROW>(image->row(static_cast<int>(jpeg->next_scanline)));
    jpeg_write_scanlines(jpeg, &row, 1);
  }
  jpeg_finish_compress(jpeg);
  return true;
}

}  // namespace

std::string encode_png(const Image& image, PngCompression compression) {
  const int c = image.channels;
  require_sound(image, c == 1 || c == 3 || c == 4, "encode_png", "1, 3 or 4");
  PngLayout layout;
  layout.width = image.width;
  layout.height = image.height;
  layout.method = compression == PngCompression::kSmall ? kSmoothMap
                  : is_photograph(image)                ? kPhotograph
                                                        : kDrawing;
  layout.color = c == 1   ? PNG_COLOR_TYPE_GRAY
                 : c == 3 ? PNG_COLOR_TYPE_RGB
                          : PNG_COLOR_TYPE_RGB_ALPHA;
  layout.rows = image.data.data();
  layout.row_bytes = static_cast<std::size_t>(image.width) * static_cast<std::size_t>(c);
  return encode(layout);
}

std::string encode_png16(int width, int height, const std::vector<std::uint16_t>& values) {
  if (width < 1 || height < 1 || width > kMaxSide || height > kMaxSide ||
      values.size() != static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {
    throw std::invalid_argument(
        fmt::format("encode_png16: image of {} x {} with {} values, expected one for each pixel",
                    width, height, values.size()));
  }
  std::vector<std::uint8_t> rows;  // the higher byte first
  rows.reserve(2 * values.size());
  for (const std::uint16_t value : values) {
    rows.push_back(static_cast<std::uint8_t>(value >> 8));
    rows.push_back(static_cast<std::uint8_t>(value & 255));
  }
  PngLayout layout;
  layout.width = width;
  layout.height = height;
  layout.bits = 16;
  layout.color = PNG_COLOR_TYPE_GRAY;
  layout.rows = rows.data();
  layout.row_bytes = 2 * static_cast<std::size_t>(width);
  return encode(layout);
}

std::string encode_jpeg(const Image& image, int quality) {
  require_sound(image, image.channels == 3, "encode_jpeg", "3");
  JpegSink sink;
  jpeg_compress_struct jpeg;
  std::memset(&jpeg, 0, sizeof(jpeg));
  jpeg.err = jpeg_std_error(&sink.base);
  sink.base.error_exit = jpeg_sink_fail;
  struct Guard {
    jpeg_compress_struct* jpeg;
    JpegSink* sink;
    ~Guard() {
      jpeg_destroy_compress(jpeg);
      std::free(sink->bytes);
    }
  } guard{&jpeg, &sink};
  if (!put_jpeg(&jpeg, &sink, &image, quality)) {
    throw MachineError("the JPEG library cannot write an image");
  }
  return {reinterpret_cast<const char*>(sink.bytes), sink.size};
}

void write_png(const Image& image, const std::filesystem::path& path) {
  write_file_atomically(path, encode_png(image));
}

}  // namespace camber
