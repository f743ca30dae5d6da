#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace camber::test {

/// Writes a PNG file. @param color_type PNG's: 0 grey, 2 RGB, 3 palette (grey ramp), 4 grey and
/// alpha, 6 RGB and alpha. @param samples row by row; 16-bit samples as two bytes, high byte first;
/// samples of less than 8 bits one a byte.
void write_png(const std::filesystem::path& path, int width, int height, int color_type, int bits,
               const std::vector<std::uint8_t>& samples, bool interlaced = false);

/// Writes a JPEG file of 1 or 3 channels, quality 95.
void write_jpeg(const std::filesystem::path& path, int width, int height, int channels,
                const std::vector<std::uint8_t>& samples);

/// A grey picture with structure: sample(x, y) = (7 x + 13 y) mod 256 by channel.
std::vector<std::uint8_t> picture(int width, int height, int channels);

std::string read_bytes(const std::filesystem::path& path);
void write_bytes(const std::filesystem::path& path, const std::string& bytes);

}  // namespace camber::test
