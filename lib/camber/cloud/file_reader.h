#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "camber/core/errors.h"

namespace camber {

/// The bytes of a file (or of memory, which must outlive it) at any place.
class FileBytes {
 public:
  FileBytes(int descriptor, std::uint64_t size, std::string name);  ///< takes the descriptor over
  FileBytes(const void* data, std::size_t size, std::string name);
  ~FileBytes();
  FileBytes(const FileBytes&) = delete;
  FileBytes& operator=(const FileBytes&) = delete;

  const std::string& name() const { return name_; }
  std::uint64_t size() const { return size_; }
  /// @throws InputError where the file ends before, without taking memory, or cannot be read.
  std::string read(std::uint64_t start, std::uint64_t length) const;
  /// Throws an InputError at a byte of the file.
  [[noreturn]] void fail_at(std::uint64_t byte, const std::string& reason) const;

 private:
  int descriptor_ = -1;
  const unsigned char* data_ = nullptr;
  std::uint64_t size_ = 0;
  std::string name_;
};

/// Sequential reading of a file (or of bytes in memory) through a buffer that holds a window of it.
/// Never holds more than was asked for plus one chunk. A file that shrinks while it is being read
/// ends in an InputError.
class FileReader {
 public:
  explicit FileReader(const std::filesystem::path& path);
  FileReader(const void* data, std::size_t size, std::string name);
  ~FileReader();
  FileReader(const FileReader&) = delete;
  FileReader& operator=(const FileReader&) = delete;

  const std::string& name() const { return name_; }
  std::uint64_t size() const { return size_; }          ///< of the whole file, bytes
  std::uint64_t position() const { return position_; }  ///< of data()[0] in the file
  std::uint64_t remaining() const { return size_ - position_; }
  const unsigned char* data() const { return data_; }   ///< the window
  std::size_t available() const { return available_; }  ///< bytes in the window
  const char* text() const { return reinterpret_cast<const char*>(data_); }

  /// Makes the window hold at least `bytes` (and usually more); false if the file ends before.
  bool fill(std::size_t bytes);
  /// Moves the window's start; `bytes` must be in the window.
  void consume(std::size_t bytes) {
    data_ += bytes;
    available_ -= bytes;
    position_ += bytes;
  }
  /// Moves past `bytes`, which may reach beyond the window; false if the file ends before.
  bool skip(std::uint64_t bytes);

  /// The same file at any place; reading there does not move the window.
  std::shared_ptr<const FileBytes> bytes() const;

  /// Throws an InputError at a byte of the file.
  [[noreturn]] void fail_at(std::uint64_t byte, const std::string& reason) const;

 private:
  void read_more(std::size_t bytes);

  std::string name_;
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
  std::uint64_t position_ = 0;
  const unsigned char* data_ = nullptr;
  const void* memory_ = nullptr;  ///< the whole, where it is no file
  std::size_t available_ = 0;
  std::unique_ptr<unsigned char[]> buffer_;
  std::size_t capacity_ = 0;
};

/// Lines of a text file, or of the text header of a binary one. Ends are LF, CR LF or, where the
/// file's first line ends so, CR alone.
class LineReader {
 public:
  explicit LineReader(FileReader& file) : file_(file) {}

  /// The next line without its end, valid until the next call; false at the end of the file.
  /// @throws InputError for a line of more than `limit` bytes.
  bool next(std::string_view& line, std::size_t limit = kLineLimit);
  std::uint64_t line() const { return line_; }  ///< number of the line that next() gave, from 1
  void set_carriage_return_ends() { end_ = '\r'; }
  /// How the line that next() gave ends: "LF", "CR LF", "CR"; "" for a last line without an end.
  const char* ends() const { return ends_; }

  /// Throws an InputError at the current line.
  [[noreturn]] void fail(const std::string& reason) const;

  static constexpr std::size_t kLineLimit = std::size_t{1} << 26;

 private:
  FileReader& file_;
  std::uint64_t line_ = 0;
  std::size_t pending_ = 0;  ///< bytes of the current line, consumed by the next call
  const char* ends_ = "";
  char end_ = '\n';

 public:
  /// Consumes the current line, so that the file stands behind it.
  void release() {
    file_.consume(pending_);
    pending_ = 0;
  }
};

/// A piece of a file for a message: in quotes, shortened, unprintable bytes in hexadecimal.
std::string shown(std::string_view text);

}  // namespace camber
