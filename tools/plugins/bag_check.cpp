#include "bag_check.h"

#include <bzlib.h>
#include <fmt/format.h>
#include <roslz4/lz4s.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/read_file.h"

namespace camber::tools {
namespace {

/// The records' kinds.
enum Op : int {
  kMessage = 2,
  kBagHeader = 3,
  kIndex = 4,
  kChunk = 5,
  kChunkInfo = 6,
  kConnection = 7,
};

/// Longest chunk, unpacked, and longest other record. ROS writes chunks of 768 kB and one message.
constexpr std::uint64_t kMaxChunk = std::uint64_t{1} << 30;

using Fields = std::map<std::string, std::string, std::less<>>;

/// Records that lie behind each other, in the file or in a chunk.
class RecordReader {
 public:
  struct Record {
    std::uint64_t at = 0;  // of its start
    Fields fields;
    std::string data;
    int op = 0;
  };

  /// @param where  what the offsets count from, for messages.
  RecordReader(std::string file, std::string where)
      : file_(std::move(file)), where_(std::move(where)) {}

  [[noreturn]] void fail(std::uint64_t at, const std::string& reason) const {
    throw InputError(file_, fmt::format("byte {}{}", at, where_), "found a damaged bag: " + reason);
  }

  /// "name=value" with a length before each.
  Fields fields(std::uint64_t at, std::string_view bytes) const {
    Fields out;
    while (!bytes.empty()) {
      std::uint32_t length = 0;
      if (bytes.size() >= 4) std::memcpy(&length, bytes.data(), 4);
      if (bytes.size() < 4 || length > bytes.size() - 4) {
        fail(at, "a field that is longer than its record's header");
      }
      const std::string_view field = bytes.substr(4, length);
      const std::size_t equals = field.find('=');
      if (equals == std::string_view::npos) fail(at, "a field without a name");
      out[std::string(field.substr(0, equals))] = std::string(field.substr(equals + 1));
      bytes.remove_prefix(4 + std::size_t{length});
    }
    return out;
  }

  template <typename T>
  T number(const Record& record, std::string_view name) const {
    const auto found = record.fields.find(name);
    if (found == record.fields.end() || found->second.size() != sizeof(T)) {
      fail(record.at, fmt::format("no field {} of {} bytes", name, sizeof(T)));
    }
    T out;
    std::memcpy(&out, found->second.data(), sizeof(T));
    return out;
  }

  void set_op(Record* record) const { record->op = number<std::uint8_t>(*record, "op"); }

 private:
  std::string file_, where_;
};

/// What the index may refer to in one chunk.
struct ChunkContent {
  std::vector<std::uint32_t> starts;  // of records, ascending
  std::uint32_t last_message = 0;
  bool any_message = false;
  std::size_t indices = 0;  // records of the index behind it
};

class BagCheck {
 public:
  explicit BagCheck(const std::filesystem::path& path)
      : name_(path.string()), file_(path, std::ios::binary), records_(name_, "") {
    std::error_code error;
    if (!std::filesystem::exists(path, error)) {
      throw InputError(name_, "no such file, expected a bag");
    }
    if (!std::filesystem::is_regular_file(path, error) || !file_) {
      throw InputError(name_, "cannot be read, expected a bag");
    }
    size_ = std::filesystem::file_size(path);
  }

  void run() {
    check_magic();
    std::uint64_t at = 13;
    const RecordReader::Record header = next(&at);
    if (header.op != kBagHeader) records_.fail(header.at, "no bag header");
    const auto index_at = records_.number<std::uint64_t>(header, "index_pos");
    const auto connections = records_.number<std::uint32_t>(header, "conn_count");
    const auto chunks = records_.number<std::uint32_t>(header, "chunk_count");
    const auto encryptor = header.fields.find("encryptor");
    if (encryptor != header.fields.end() && !encryptor->second.empty()) {
      throw InputError(name_, "found an encrypted bag, expected one that is not");
    }
    if (index_at == 0) {
      throw InputError(name_,
                       "found a bag whose recording was not finished, expected one with its index "
                       "(rosbag reindex makes it)");
    }
    while (at < size_ && at < index_at) before_index(&at);
    if (at != index_at) records_.fail(at, "its index does not start where its header states");
    for (std::uint32_t i = 0; i < connections; ++i) {
      const RecordReader::Record record = next(&at);
      if (record.op != kConnection) records_.fail(record.at, "a connection is missing");
      check_connection(records_, record);
    }
    for (std::uint32_t i = 0; i < chunks; ++i) check_chunk_info(next(&at));
  }

 private:
  void check_magic() {
    std::string start(std::min<std::uint64_t>(size_, 16), '\0');
    file_.read(start.data(), static_cast<std::streamsize>(start.size()));
    if (start.compare(0, 13, "#ROSBAG V2.0\n") == 0) return;
    std::string found = size_ == 0 ? "an empty file" : "a file that is no bag";
    if (start.compare(0, 6, "SQLite") == 0 || start.find("MCAP") == 1) {
      found = "a recording of ROS 2";
    } else if (start.compare(0, 8, "#ROSBAG ") == 0) {
      found = "a bag of the version " + printable(start.substr(8, start.find('\n') - 8));
    }
    throw InputError(name_, "found " + found + ", expected a bag of ROS 1 (#ROSBAG V2.0)");
  }

  std::string bytes(std::uint64_t record, std::uint64_t at, std::uint64_t count) {
    if (at > size_ || count > size_ - at) records_.fail(record, "it ends within a record");
    if (count > kMaxChunk) records_.fail(record, fmt::format("a record of {} bytes", count));
    std::string out(count, '\0');
    file_.seekg(static_cast<std::streamoff>(at));
    if (!file_.read(out.data(), static_cast<std::streamsize>(count))) {
      throw InputError(name_, "cannot be read, expected a bag");
    }
    return out;
  }

  /// The record at `*at`, which is moved behind it.
  RecordReader::Record next(std::uint64_t* at) {
    throw_if_interrupted();
    RecordReader::Record out;
    out.at = *at;
    const auto block = [&]() {
      std::uint32_t length = 0;
      std::memcpy(&length, bytes(out.at, *at, 4).data(), 4);
      std::string content = bytes(out.at, *at + 4, length);
      *at += 4 + std::uint64_t{length};
      return content;
    };
    out.fields = records_.fields(out.at, block());
    records_.set_op(&out);
    out.data = block();
    return out;
  }

  void before_index(std::uint64_t* at) {
    const RecordReader::Record record = next(at);
    if (record.op == kChunk) {
      chunk_at_ = record.at;
      chunks_[chunk_at_] = check_chunk(record);
    } else if (record.op == kIndex) {
      check_index(record);
    } else {
      records_.fail(record.at, fmt::format("a record of the kind {} among its chunks", record.op));
    }
  }

  std::string unpacked(const RecordReader::Record& record) const {
    const auto stated = records_.number<std::uint32_t>(record, "size");
    const auto compression = record.fields.find("compression");
    const std::string how = compression == record.fields.end() ? "" : compression->second;
    if (stated > kMaxChunk) records_.fail(record.at, fmt::format("a chunk of {} bytes", stated));
    if (how == "none") {
      if (stated != record.data.size()) records_.fail(record.at, "a chunk of another size");
      return record.data;
    }
    std::string out(stated, '\0');
    unsigned int size = stated;
    const auto packed = static_cast<unsigned int>(record.data.size());
    auto* from = const_cast<char*>(record.data.data());  // read only, by both
    bool whole = false;
    if (how == "bz2") {
      whole = BZ2_bzBuffToBuffDecompress(out.data(), &size, from, packed, 0, 0) == BZ_OK;
    } else if (how == "lz4") {
      whole = roslz4_buffToBuffDecompress(from, packed, out.data(), &size) == ROSLZ4_OK;
    } else {
      records_.fail(record.at, "a chunk with the compression \"" + printable(how) + "\"");
    }
    if (!whole || size != stated) records_.fail(record.at, "a chunk that cannot be unpacked");
    return out;
  }

  ChunkContent check_chunk(const RecordReader::Record& chunk) const {
    const std::string content = unpacked(chunk);
    const RecordReader inner(name_, fmt::format(" of the chunk at byte {}", chunk.at));
    ChunkContent out;
    std::size_t at = 0;
    while (at < content.size()) {
      RecordReader::Record record;
      record.at = at;
      const auto block = [&]() {
        std::uint32_t length = 0;
        if (content.size() - at >= 4) std::memcpy(&length, content.data() + at, 4);
        if (content.size() - at < 4 || length > content.size() - at - 4) {
          inner.fail(record.at, "it ends within a record");
        }
        const std::string_view taken(content.data() + at + 4, length);
        at += 4 + std::size_t{length};
        return taken;
      };
      record.fields = inner.fields(record.at, block());
      inner.set_op(&record);
      const std::string_view data = block();
      out.starts.push_back(static_cast<std::uint32_t>(record.at));
      if (record.op == kMessage) {
        inner.number<std::uint32_t>(record, "conn");
        inner.number<std::uint64_t>(record, "time");
        out.last_message = out.starts.back();
        out.any_message = true;
      } else if (record.op == kConnection) {
        record.data = data;
        check_connection(inner, record);
      } else {
        inner.fail(record.at, fmt::format("a record of the kind {} in a chunk", record.op));
      }
    }
    return out;
  }

  static void check_connection(const RecordReader& records, const RecordReader::Record& record) {
    records.number<std::uint32_t>(record, "conn");
    const Fields fields = records.fields(record.at, record.data);
    if (record.fields.find("topic") == record.fields.end() || fields.count("type") == 0 ||
        fields.count("md5sum") == 0 || fields.count("message_definition") == 0) {
      records.fail(record.at, "a connection without a topic or a type");
    }
  }

  /// An index record: time and offset of each message of one connection in the last chunk.
  void check_index(const RecordReader::Record& record) {
    const auto count = records_.number<std::uint32_t>(record, "count");
    records_.number<std::uint32_t>(record, "conn");
    if (records_.number<std::uint32_t>(record, "ver") != 1 || chunks_.empty() ||
        record.data.size() != std::uint64_t{count} * 12) {
      records_.fail(record.at, "an index of another form");
    }
    ChunkContent& chunk = chunks_[chunk_at_];
    ++chunk.indices;
    for (std::uint32_t i = 0; i < count; ++i) {
      std::uint32_t offset = 0;
      std::memcpy(&offset, record.data.data() + std::size_t{i} * 12 + 8, 4);
      // A connection's record may stand before the message that is meant.
      if (!chunk.any_message || offset > chunk.last_message ||
          !std::binary_search(chunk.starts.begin(), chunk.starts.end(), offset)) {
        records_.fail(record.at, "an index of messages that are not there");
      }
    }
  }

  void check_chunk_info(const RecordReader::Record& record) const {
    if (record.op != kChunkInfo) records_.fail(record.at, "a summary of a chunk is missing");
    const auto count = records_.number<std::uint32_t>(record, "count");
    const auto chunk = chunks_.find(records_.number<std::uint64_t>(record, "chunk_pos"));
    records_.number<std::uint64_t>(record, "start_time");
    records_.number<std::uint64_t>(record, "end_time");
    if (records_.number<std::uint32_t>(record, "ver") != 1 || chunk == chunks_.end() ||
        record.data.size() != std::uint64_t{count} * 8 || chunk->second.indices != count) {
      records_.fail(record.at, "a summary of a chunk that is not there");
    }
  }

  std::string name_;
  std::ifstream file_;
  RecordReader records_;
  std::uint64_t size_ = 0;
  std::map<std::uint64_t, ChunkContent> chunks_;  // by where they start
  std::uint64_t chunk_at_ = 0;                    // of the last one
};

}  // namespace

void check_bag(const std::filesystem::path& path) { BagCheck(path).run(); }

}  // namespace camber::tools
