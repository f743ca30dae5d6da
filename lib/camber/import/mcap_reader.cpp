// MCAP files, by the specification of mcap.dev.

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <optional>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/read_file.h"
#include "camber/import/detail/compressed_bytes.h"
#include "camber/import/detail/mcap.h"
#include "camber/import/recording.h"

namespace camber {
namespace detail {

std::uint32_t mcap_crc(std::string_view bytes) {
  uLong crc = ::crc32(0, nullptr, 0);
  while (!bytes.empty()) {
    const std::size_t part = std::min<std::size_t>(bytes.size(), std::size_t{1} << 30);
    crc = ::crc32(crc, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(part));
    bytes.remove_prefix(part);
  }
  return static_cast<std::uint32_t>(crc);
}

}  // namespace detail

namespace {

using detail::kMcapMagic;
using detail::McapRecord;

constexpr std::size_t kRecordHeader = 9;                      // kind and length
constexpr std::uint64_t kMostChunk = std::uint64_t{1} << 31;  // bytes of its records
constexpr std::uint64_t kMostHead = std::uint64_t{1} << 26;   // of schemas and channels

/// Takes a record apart.
class Fields {
 public:
  Fields(std::string_view bytes, const std::string& file, std::string position)
      : bytes_(bytes), file_(file), position_(std::move(position)) {}

  template <typename T>
  T number() {
    T out;
    std::memcpy(&out, take(sizeof(T)).data(), sizeof(T));
    return out;
  }
  std::string_view text() { return take(number<std::uint32_t>()); }
  std::string_view take(std::uint64_t size) {
    if (size > bytes_.size()) {
      throw InputError(
          file_, position_,
          fmt::format("found {} of {} bytes, expected a whole record", bytes_.size(), size));
    }
    const std::string_view out = bytes_.substr(0, static_cast<std::size_t>(size));
    bytes_.remove_prefix(static_cast<std::size_t>(size));
    return out;
  }
  std::string_view rest() const { return bytes_; }
  bool empty() const { return bytes_.empty(); }

 private:
  std::string_view bytes_;
  const std::string& file_;
  std::string position_;
};

struct Channel {
  std::string topic, encoding;
  std::uint16_t schema = 0;
};

class McapReader : public BagReader {
 public:
  explicit McapReader(std::shared_ptr<const FileBytes> file) : file_(std::move(file)) { scan(); }

  const std::vector<Topic>& topics() const override { return topics_; }

  void read(const std::string& topic, const std::function<bool(const BagMessage&)>& take) override {
    for (const Block& block : blocks_) {
      if (std::find(block.topics.begin(), block.topics.end(), topic) == block.topics.end()) {
        continue;
      }
      throw_if_interrupted();
      bool more = true;
      const auto each = [&](const Channel& channel, const BagMessage& message) {
        if (more && channel.topic == topic) more = take(message);
      };
      if (block.chunk) {
        const std::string records = unpack(block);
        read_records(records, position_of(block), each);
      } else {
        const std::string record = file_->read(block.start, block.size);
        read_message(Fields(record, file_->name(), position_of(block)), each);
      }
      if (!more) return;
    }
  }

 private:
  /// A chunk, or a message that is in none.
  struct Block {
    bool chunk = false;
    std::uint64_t start = 0, size = 0;  // of the record's content
    std::size_t number = 0;             // among the chunks
    std::vector<std::string> topics;
  };
  using Each = std::function<void(const Channel&, const BagMessage&)>;

  std::string position_of(const Block& block) const {
    return block.chunk ? fmt::format("chunk {} at byte {}", block.number, block.start)
                       : fmt::format("byte {}", block.start);
  }

  void scan();
  std::string unpack(const Block& block) const;
  void take_schema(Fields fields);
  void take_channel(Fields fields);
  void read_message(Fields fields, const Each& each) const;
  void read_records(std::string_view records, const std::string& position, const Each& each);

  std::shared_ptr<const FileBytes> file_;
  std::map<std::uint16_t, std::string> schemas_;  // name of the type
  std::map<std::uint16_t, Channel> channels_;
  std::vector<Block> blocks_;
  std::vector<Topic> topics_;
};

void McapReader::take_schema(Fields fields) {
  const auto id = fields.number<std::uint16_t>();
  schemas_[id] = std::string(fields.text());
}

void McapReader::take_channel(Fields fields) {
  const auto id = fields.number<std::uint16_t>();
  Channel channel;
  channel.schema = fields.number<std::uint16_t>();
  channel.topic = std::string(fields.text());
  channel.encoding = std::string(fields.text());
  channels_[id] = std::move(channel);
}

void McapReader::read_message(Fields fields, const Each& each) const {
  const auto id = fields.number<std::uint16_t>();
  fields.number<std::uint32_t>();  // sequence
  const auto log_time = fields.number<std::uint64_t>();
  fields.number<std::uint64_t>();  // time of publication
  const auto channel = channels_.find(id);
  if (channel == channels_.end()) return;  // of no topic: by the specification passed over
  const std::string_view data = fields.rest();
  each(channel->second, {reinterpret_cast<const std::uint8_t*>(data.data()), data.size(),
                         static_cast<std::int64_t>(log_time)});
}

void McapReader::read_records(std::string_view records, const std::string& position,
                              const Each& each) {
  Fields all(records, file_->name(), position);
  while (!all.empty()) {
    const auto kind = static_cast<McapRecord>(all.number<std::uint8_t>());
    const std::string_view content = all.take(all.number<std::uint64_t>());
    const Fields fields(content, file_->name(), position);
    if (kind == McapRecord::kSchema) take_schema(fields);
    if (kind == McapRecord::kChannel) take_channel(fields);
    if (kind == McapRecord::kMessage) read_message(fields, each);
  }
}

/// The records of a chunk. Its checksum is compared.
std::string McapReader::unpack(const Block& block) const {
  const std::string content = file_->read(block.start, block.size);
  const std::string position = position_of(block);
  Fields fields(content, file_->name(), position);
  fields.number<std::uint64_t>();  // first and last time
  fields.number<std::uint64_t>();
  const auto size = fields.number<std::uint64_t>();
  const auto crc = fields.number<std::uint32_t>();
  const std::string_view compression = fields.text();
  const std::string_view data = fields.take(fields.number<std::uint64_t>());
  if (size > kMostChunk) {
    throw InputError(
        file_->name(), position,
        fmt::format("found a chunk of {} bytes, expected at most {}", size, kMostChunk));
  }
  std::string out = detail::uncompress_block(compression, data, size, file_->name(), position);
  if (crc != 0 && detail::mcap_crc(out) != crc) {
    throw InputError(file_->name(), position,
                     fmt::format("found a chunk with the checksum {:08x}, expected {:08x}: it is "
                                 "damaged",
                                 detail::mcap_crc(out), crc));
  }
  return out;
}

void McapReader::scan() {
  const std::uint64_t size = file_->size();
  const std::string magic = file_->read(0, std::min<std::uint64_t>(size, kMcapMagic.size()));
  if (magic != kMcapMagic) {
    file_->fail_at(0, "found " + shown(magic) + ", expected an MCAP file");
  }
  std::map<std::string, Topic> by_name;
  const auto name_topic = [&](const Channel& channel) -> Topic& {
    Topic& topic = by_name[channel.topic];
    topic.name = channel.topic;
    const auto schema = schemas_.find(channel.schema);
    const std::string type =
        schema == schemas_.end() ? std::string() : short_message_type(schema->second);
    if (topic.type.empty()) topic.type = type;
    if (topic.type != type) topic.type = "several types";
    topic.cdr = channel.encoding == "cdr";
    return topic;
  };
  std::uint64_t place = kMcapMagic.size();
  std::size_t chunks = 0;
  bool ended = false;
  while (!ended) {
    throw_if_interrupted();
    if (size - place < kRecordHeader) {
      file_->fail_at(place, "found the end of the file, expected the end of its data");
    }
    const std::string head = file_->read(place, kRecordHeader);
    const auto kind = static_cast<McapRecord>(head[0]);
    std::uint64_t length = 0;
    std::memcpy(&length, head.data() + 1, sizeof length);
    if (length > size - place - kRecordHeader) {
      file_->fail_at(place, fmt::format("found a record of {} bytes, expected at most {}, which "
                                        "the file has (is it cut?)",
                                        length, size - place - kRecordHeader));
    }
    Block block;
    block.start = place + kRecordHeader;
    block.size = length;
    place = block.start + length;
    const auto add = [&](const Channel& channel, const BagMessage&) {
      ++name_topic(channel).messages;
      if (std::find(block.topics.begin(), block.topics.end(), channel.topic) ==
          block.topics.end()) {
        block.topics.push_back(channel.topic);
      }
    };
    switch (kind) {
      case McapRecord::kSchema:
      case McapRecord::kChannel: {
        if (length > kMostHead) file_->fail_at(block.start, "found a record that is too long");
        const std::string content = file_->read(block.start, length);
        const Fields fields(content, file_->name(), position_of(block));
        if (kind == McapRecord::kSchema) {
          take_schema(fields);
        } else {
          take_channel(fields);
        }
        break;
      }
      case McapRecord::kMessage: {
        const std::string content = file_->read(block.start, length);
        read_message(Fields(content, file_->name(), position_of(block)), add);
        blocks_.push_back(block);
        break;
      }
      case McapRecord::kChunk:
        block.chunk = true;
        block.number = chunks++;
        read_records(unpack(block), position_of(block), add);
        blocks_.push_back(block);
        break;
      case McapRecord::kDataEnd:
      case McapRecord::kFooter:
        ended = true;
        break;
      default:  // indices, attachments, metadata and what later versions add
        break;
    }
  }
  for (const auto& [id, channel] : channels_) name_topic(channel);
  for (auto& [name, topic] : by_name) topics_.push_back(topic);
}

}  // namespace

std::string short_message_type(const std::string& type) {
  const std::size_t at = type.find("/msg/");
  return at == std::string::npos ? type : type.substr(0, at) + type.substr(at + 4);
}

std::unique_ptr<BagReader> open_mcap(const std::filesystem::path& path) {
  return std::make_unique<McapReader>(FileReader(path).bytes());
}

std::unique_ptr<BagReader> open_mcap(const void* data, std::size_t size, const std::string& name) {
  return std::make_unique<McapReader>(std::make_shared<FileBytes>(data, size, name));
}

}  // namespace camber
