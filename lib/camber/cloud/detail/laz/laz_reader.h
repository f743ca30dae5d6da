#pragma once

#include <memory>
#include <string>
#include <vector>

#include "camber/cloud/detail/laz/chunk_codec.h"

namespace camber::laz {

struct LazReadOptions {
  bool lenient = false;             ///< the points before damage are kept
  int num_threads = 0;              ///< <= 0: see resolve_num_threads
  std::uint32_t wanted = kWantAll;  ///< Wanted; what is not is as in a chunk's first point
};

/// The records of a LAZ file, in its order. Chunks are decoded by several threads, a few at a
/// time, with the same result for any number of threads.
class LazReader {
 public:
  LazReader(const LasFile& las, const LazReadOptions& options);
  ~LazReader();

  /// The next records, which stay until the next call.
  /// @return how many, at most `most`; 0 at the end
  /// @throws InputError that names chunk and byte, where one is damaged
  std::size_t next(const unsigned char** records, std::size_t most);

  /// What a user should know, one sentence each; complete at the end.
  const std::vector<std::string>& notes() const { return notes_; }

 private:
  struct Whole {  // a chunk, decoded
    std::vector<unsigned char> records;
    std::size_t count = 0;
    std::string error;
  };
  class Window;

  bool decode_group();
  void decode_whole(std::size_t chunk, Whole* out) const;
  std::size_t next_in_turn(const unsigned char** records, std::size_t most);
  bool open_next();
  [[noreturn]] void fail(std::size_t chunk, std::uint64_t done, const std::string& reason) const;
  void note_damage(std::size_t chunk, std::uint64_t done, const std::string& reason);

  const LasFile& las_;
  const LazLayout& layout_;
  LazReadOptions options_;
  std::vector<std::string> notes_;
  std::uint64_t left_ = 0;  // points
  bool stopped_ = false;

  std::vector<Whole> group_;
  std::size_t next_chunk_ = 0;               // the first that is not decoded
  std::size_t at_chunk_ = 0, at_point_ = 0;  // of the group

  // Chunks that are decoded piece by piece: large ones, and those whose ends are not known.
  std::unique_ptr<Window> window_;
  std::unique_ptr<ChunkDecoder> decoder_;
  std::string chunk_bytes_;
  std::uint64_t left_in_chunk_ = 0;
  const unsigned char* position_ = nullptr;
  std::vector<unsigned char> piece_;
};

}  // namespace camber::laz
