#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

namespace camber::detail {

/// A file without a name, which is gone with its process, however that ends.
class UnnamedFile {
 public:
  /// @param beside  a file that is written: this one is in its folder and named so in messages;
  ///                empty: in the folder of the system's temporary files
  /// @param stream  if given, is opened to write the file from its start
  /// @throws OutputError
  explicit UnnamedFile(const std::filesystem::path& beside, std::ofstream* stream = nullptr);
  ~UnnamedFile();
  UnnamedFile(const UnnamedFile&) = delete;
  UnnamedFile& operator=(const UnnamedFile&) = delete;

  /// @throws OutputError
  void write(std::uint64_t at, const char* bytes, std::size_t size) const;
  void read(std::uint64_t at, char* bytes, std::size_t size) const;
  std::uint64_t size() const;
  int release() noexcept;  ///< its descriptor, for the caller to close

  const std::string& name() const { return name_; }
  [[noreturn]] void fail(const char* what) const;  ///< with the reason in errno

  /// Where such a file is made.
  static std::filesystem::path folder_of(const std::filesystem::path& beside);

 private:
  std::string name_;
  int descriptor_ = -1;
};

}  // namespace camber::detail
