#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "camber/image/image_io.h"

namespace camber {

/// Pictures one after another into a film: .mp4 (H.264 where OpenCV has an encoder, else MPEG-4) or
/// .avi (Motion JPEG). The file appears whole with finish() or not at all.
class FilmWriter {
 public:
  /// @param pictures_per_second  in (0, 240].
  /// @throws std::invalid_argument for another extension or rate; OutputError if the place is not
  ///         writable.
  FilmWriter(const std::filesystem::path& path, double pictures_per_second);
  ~FilmWriter();
  FilmWriter(const FilmWriter&) = delete;
  FilmWriter& operator=(const FilmWriter&) = delete;

  static bool knows(const std::string& extension);  ///< ".mp4", ".avi"

  /// @param picture  3 channels, of one size for all; an odd side gets a white row or column, as
  ///                 encoders ask for even ones.
  /// @throws std::invalid_argument for another size; MachineError without an encoder.
  void add(const Image& picture);

  /// Closes the film, reads it back to see that all pictures are there, gives it its name.
  /// @throws OutputError if it is not whole (disk full); std::invalid_argument without pictures.
  void finish();

  /// "H.264", "MPEG-4", "Motion JPEG"; empty before the first picture.
  const std::string& codec() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Films of one encoder, size and rate, as FilmWriter makes them, into one, without encoding them
/// again: each begins where the one before ends. The film appears whole or not at all.
/// @throws InputError for a part that cannot be read or that differs; OutputError.
void join_films(const std::vector<std::filesystem::path>& parts, const std::filesystem::path& path);

}  // namespace camber
