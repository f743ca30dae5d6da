#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

namespace camber::test {

/// Root of the checkout.
std::filesystem::path source_dir();

/// The shared real data: $CAMBER_DATA, else ../shared/data beside the checkout; may not exist.
std::filesystem::path data_dir();

/// A file's bytes; empty where it cannot be read.
std::string read_text(const std::filesystem::path& path);

/// A fresh empty folder, removed when the object dies.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace camber::test

/// Skips the test, saying so, where a file or folder of the shared data is absent.
#define CAMBER_REQUIRE_DATA(relative)                                      \
  do {                                                                     \
    if (!std::filesystem::exists(camber::test::data_dir() / (relative))) { \
      GTEST_SKIP() << "no ../shared/data (set CAMBER_DATA): "              \
                   << camber::test::data_dir() / (relative);               \
    }                                                                      \
  } while (false)
