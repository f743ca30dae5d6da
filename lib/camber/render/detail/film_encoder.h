#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

namespace camber {

// What films ask of OpenCV's videoio, which brings more than two hundred shared libraries: behind
// these functions a program can load it when the first of them is called (tools/plugins).

/// Writes pictures of one size into a film; closed by the destructor.
class FilmEncoder {
 public:
  virtual ~FilmEncoder() = default;
  /// @param pixels  height rows of width times red, green, blue.
  virtual void write(const std::uint8_t* pixels) = 0;
};

/// @param codec  four letters. @param width, height  even.
/// @return nullptr where there is no such encoder.
std::unique_ptr<FilmEncoder> open_film_encoder(const std::filesystem::path& path, const char* codec,
                                               double pictures_per_second, int width, int height);

/// Pictures that can be read from a film, at most `enough`.
int count_film_pictures(const std::filesystem::path& path, int enough);

/// Films of one encoder, size and rate into one, without decoding: each begins where the one before
/// ends. @throws InputError for one that cannot be read or that differs; OutputError.
void join_film_files(const std::vector<std::filesystem::path>& parts,
                     const std::filesystem::path& out);

}  // namespace camber
