#pragma once

#include <cstdint>
#include <map>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include "camber/export/foxglove.h"

namespace camber {

/// Writes an MCAP file (mcap.dev, version 0) to a stream: chunks by zstd with their index, a
/// summary. Memory of one chunk.
class McapWriter : public MessageSink {
 public:
  /// @param chunk_size  bytes of messages that are compressed together
  explicit McapWriter(std::ostream& out, std::size_t chunk_size = std::size_t{1} << 20);

  std::uint16_t add_schema(const std::string& name, const std::string& json_schema) override;
  std::uint16_t add_channel(std::uint16_t schema, const std::string& topic) override;
  void write(std::uint16_t channel, std::uint64_t time_ns, std::string_view message) override;
  void finish() override;

 private:
  struct Chunk {
    std::uint64_t first = 0, last = 0, start = 0, length = 0, index_length = 0, compressed = 0,
                  uncompressed = 0;
    std::map<std::uint16_t, std::uint64_t> index;  // place of each channel's
  };
  void put(const std::string& bytes);
  void end_chunk();

  std::ostream& out_;
  std::size_t chunk_size_;
  std::uint64_t place_ = 0;
  std::vector<std::string> schemas_, channels_;  // records, which the summary repeats
  std::string records_;                          // of the chunk
  std::uint64_t first_ = 0, last_ = 0;           // times in the chunk
  std::map<std::uint16_t, std::string> index_;   // times and places in the chunk, by channel
  std::vector<Chunk> chunks_;
  std::map<std::uint16_t, std::uint64_t> counts_;
  std::map<std::uint16_t, std::uint32_t> sequences_;
};

}  // namespace camber
