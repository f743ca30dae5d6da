#include "scene/write_image.h"

#include <png.h>

#include <cstdio>
#include <fstream>
#include <sstream>
#include <stdexcept>

// jpeglib.h needs size_t and FILE before it.
#include <jpeglib.h>

namespace camber::test {
namespace {

struct File {
  explicit File(const std::filesystem::path& path) : handle(std::fopen(path.c_str(), "wb")) {
    if (!handle) throw std::runtime_error("cannot write " + path.string());
  }
  ~File() { std::fclose(handle); }
  std::FILE* handle;
};

}  // namespace

void write_png(const std::filesystem::path& path, int width, int height, int color_type, int bits,
               const std::vector<std::uint8_t>& samples, bool interlaced) {
  const File file(path);
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, file.handle);
  png_set_IHDR(png, info, static_cast<png_uint_32>(width), static_cast<png_uint_32>(height), bits,
               color_type, interlaced ? PNG_INTERLACE_ADAM7 : PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  std::vector<png_color> palette;
  if (color_type == PNG_COLOR_TYPE_PALETTE) {
    for (int i = 0; i < (1 << bits); ++i) {
      const auto v = static_cast<png_byte>(255 - i);
      palette.push_back({v, v, v});
    }
    png_set_PLTE(png, info, palette.data(), static_cast<int>(palette.size()));
  }
  png_write_info(png, info);
  png_set_packing(png);
  const std::size_t row_bytes = samples.size() / static_cast<std::size_t>(height);
  std::vector<png_bytep> rows;
  for (int y = 0; y < height; ++y) {
    rows.push_back(const_cast<png_bytep>(samples.data() + static_cast<std::size_t>(y) * row_bytes));
  }
  png_write_image(png, rows.data());
  png_write_end(png, nullptr);
  png_destroy_write_struct(&png, &info);
}

void write_jpeg(const std::filesystem::path& path, int width, int height, int channels,
                const std::vector<std::uint8_t>& samples) {
  const File file(path);
  jpeg_compress_struct jpeg;
  jpeg_error_mgr errors;
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  jpeg_stdio_dest(&jpeg, file.handle);
  jpeg.image_width = static_cast<JDIMENSION>(width);
  jpeg.image_height = static_cast<JDIMENSION>(height);
  jpeg.input_components = channels;
  jpeg.in_color_space = channels == 1 ? JCS_GRAYSCALE : JCS_RGB;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, 95, TRUE);
  jpeg_start_compress(&jpeg, TRUE);
  for (int y = 0; y < height; ++y) {
    auto* row =
        const_cast<JSAMPROW>(samples.data() + static_cast<std::size_t>(y) * width * channels);
    jpeg_write_scanlines(&jpeg, &row, 1);
  }
  jpeg_finish_compress(&jpeg);
  jpeg_destroy_compress(&jpeg);
}

std::vector<std::uint8_t> picture(int width, int height, int channels) {
  std::vector<std::uint8_t> out;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < channels; ++c) {
        out.push_back(static_cast<std::uint8_t>(7 * x + 13 * y + 50 * c));
      }
    }
  }
  return out;
}

std::string read_bytes(const std::filesystem::path& path) {
  std::ostringstream out;
  out << std::ifstream(path, std::ios::binary).rdbuf();
  return out.str();
}

void write_bytes(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

}  // namespace camber::test
