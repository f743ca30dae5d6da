// Recordings of rosbag2: folders with metadata.yaml, databases of SQLite, MCAP files.

#include <fmt/format.h>
#include <sqlite3.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <map>
#include <optional>
#include <set>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/lower_case.h"
#include "camber/core/read_file.h"
#include "camber/import/detail/compressed_bytes.h"
#include "camber/import/detail/mcap.h"
#include "camber/import/recording.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr std::string_view kSqliteMagic{"SQLite format 3\0", 16};

std::string first_bytes(const fs::path& path, std::size_t count) {
  FileReader file(path);
  file.fill(count);
  return {file.text(), std::min(file.available(), count)};
}

/// A database that is opened as immutable: SQLite then writes nothing, no -wal and -shm files, and
/// reads folders without permission to write.
class Database {
 public:
  explicit Database(const fs::path& path) : name_(path.string()) {
    const std::string magic = first_bytes(path, kSqliteMagic.size());
    if (magic != kSqliteMagic) {
      throw InputError(name_, "byte 0",
                       "found " + shown(magic) + ", expected a database of SQLite");
    }
    std::string uri = "file:";
    for (const char c : fs::absolute(path).string()) {
      if (c == '%' || c == '?' || c == '#') {
        uri += fmt::format("%{:02x}", static_cast<unsigned>(c));
      } else {
        uri += c;
      }
    }
    uri += "?immutable=1";
    const int code =
        ::sqlite3_open_v2(uri.c_str(), &database_, SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, nullptr);
    if (code != SQLITE_OK) {
      const std::string reason = database_ == nullptr ? "" : ::sqlite3_errmsg(database_);
      ::sqlite3_close(database_);
      throw InputError(name_, "the database cannot be opened: " + printable(reason, 120));
    }
    // A damaged database must not run code or attach others.
    ::sqlite3_db_config(database_, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
    ::sqlite3_db_config(database_, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  }
  ~Database() { ::sqlite3_close(database_); }
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  const std::string& name() const { return name_; }
  sqlite3* get() const { return database_; }
  [[noreturn]] void fail(const std::string& what) const {
    throw InputError(name_, what + ": " + printable(::sqlite3_errmsg(database_), 120));
  }

 private:
  std::string name_;
  sqlite3* database_ = nullptr;
};

class Query {
 public:
  Query(const Database& database, const std::string& sql) : database_(database) {
    if (::sqlite3_prepare_v2(database.get(), sql.c_str(), -1, &query_, nullptr) != SQLITE_OK) {
      database_.fail("the tables are not those of rosbag2");
    }
  }
  ~Query() { ::sqlite3_finalize(query_); }
  Query(const Query&) = delete;
  Query& operator=(const Query&) = delete;

  void bind(int place, std::int64_t value) { ::sqlite3_bind_int64(query_, place, value); }
  bool next() {
    const int code = ::sqlite3_step(query_);
    if (code == SQLITE_ROW) return true;
    if (code != SQLITE_DONE) database_.fail("the database is damaged");
    return false;
  }
  std::int64_t integer(int column) { return ::sqlite3_column_int64(query_, column); }
  std::string text(int column) {
    const auto* const bytes = reinterpret_cast<const char*>(::sqlite3_column_text(query_, column));
    const int size = ::sqlite3_column_bytes(query_, column);
    return bytes == nullptr ? std::string() : std::string(bytes, static_cast<std::size_t>(size));
  }
  std::string_view blob(int column) {
    const void* const bytes = ::sqlite3_column_blob(query_, column);
    const int size = ::sqlite3_column_bytes(query_, column);
    if (bytes == nullptr) return {};
    return {static_cast<const char*>(bytes), static_cast<std::size_t>(size)};
  }

 private:
  const Database& database_;
  sqlite3_stmt* query_ = nullptr;
};

class Db3Reader : public BagReader {
 public:
  /// @param compressed  each message is a zstd frame
  Db3Reader(const fs::path& path, bool compressed) : database_(path), compressed_(compressed) {
    std::map<std::string, Topic> by_name;
    Query topics(database_, "SELECT id, name, type, serialization_format FROM topics");
    while (topics.next()) {
      Topic topic;
      topic.name = topics.text(1);
      topic.type = short_message_type(topics.text(2));
      topic.cdr = topics.text(3) == "cdr";
      ids_[topic.name].push_back(topics.integer(0));
      by_name.emplace(topic.name, topic);
    }
    // In a damaged database the count by an index may differ from the rows: the rows count.
    Query counts(database_, "SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id");
    while (counts.next()) {
      const std::int64_t id = counts.integer(0);
      for (auto& [name, topic] : by_name) {
        const std::vector<std::int64_t>& ids = ids_[name];
        if (std::find(ids.begin(), ids.end(), id) == ids.end()) continue;
        topic.messages += static_cast<std::size_t>(std::max<std::int64_t>(0, counts.integer(1)));
      }
    }
    for (auto& [name, topic] : by_name) topics_.push_back(topic);
  }

  const std::vector<Topic>& topics() const override { return topics_; }

  void read(const std::string& topic, const std::function<bool(const BagMessage&)>& take) override {
    const auto ids = ids_.find(topic);
    if (ids == ids_.end()) return;
    for (const std::int64_t id : ids->second) {
      Query messages(database_,
                     "SELECT id, timestamp, data FROM messages WHERE topic_id = ? ORDER BY id");
      messages.bind(1, id);
      while (messages.next()) {
        throw_if_interrupted();
        std::string_view data = messages.blob(2);
        std::string plain;
        if (compressed_) {
          plain = detail::uncompress_zstd(data, database_.name(),
                                          fmt::format("message {}", messages.integer(0)));
          data = plain;
        }
        if (!take({reinterpret_cast<const std::uint8_t*>(data.data()), data.size(),
                   messages.integer(1)})) {
          return;
        }
      }
    }
  }

 private:
  Database database_;
  bool compressed_;
  std::map<std::string, std::vector<std::int64_t>> ids_;
  std::vector<Topic> topics_;
};

/// The files of a folder one behind the other.
class Joined : public BagReader {
 public:
  explicit Joined(std::vector<std::unique_ptr<BagReader>> parts) : parts_(std::move(parts)) {
    std::map<std::string, Topic> by_name;
    for (const std::unique_ptr<BagReader>& part : parts_) {
      for (const Topic& topic : part->topics()) {
        const auto [at, added] = by_name.emplace(topic.name, topic);
        if (added) continue;
        at->second.messages += topic.messages;
        if (at->second.type != topic.type) at->second.type = "several types";
      }
    }
    for (auto& [name, topic] : by_name) topics_.push_back(topic);
  }

  const std::vector<Topic>& topics() const override { return topics_; }

  void read(const std::string& topic, const std::function<bool(const BagMessage&)>& take) override {
    bool more = true;
    for (std::size_t i = 0; i < parts_.size() && more; ++i) {
      parts_[i]->read(topic, [&](const BagMessage& message) { return more = take(message); });
    }
  }

 private:
  std::vector<std::unique_ptr<BagReader>> parts_;
  std::vector<Topic> topics_;
};

/// What matters here of metadata.yaml.
struct Metadata {
  std::vector<fs::path> files;
  bool messages_compressed = false;
};

Metadata read_metadata(const fs::path& folder) {
  const fs::path path = folder / "metadata.yaml";
  const std::string name = path.string();
  Metadata out;
  try {
    const YAML::Node root = YAML::Load(read_whole_file(path))["rosbag2_bagfile_information"];
    if (!root) throw InputError(name, "found no rosbag2_bagfile_information, expected it");
    const auto text = [&](const char* key) {
      const YAML::Node node = root[key];
      return node && node.IsScalar() ? lower_case(node.as<std::string>()) : std::string();
    };
    const std::string mode = text("compression_mode"), format = text("compression_format");
    if (!mode.empty() && mode != "none") {
      if (mode != "message" || format != "zstd") {
        throw InputError(name, fmt::format("found the compression {} by {}, expected none, or "
                                           "single messages by zstd (ros2 bag convert, or unpack "
                                           "the files with zstd -d)",
                                           printable(mode, 20), printable(format, 20)));
      }
      out.messages_compressed = true;
    }
    for (const YAML::Node& file : root["relative_file_paths"]) {
      const fs::path relative = file.as<std::string>();
      // Older versions wrote the folder's own name before; and nothing outside is read.
      out.files.push_back(folder / relative.filename());
    }
  } catch (const YAML::Exception& error) {
    throw InputError(name, fmt::format("line {}", error.mark.line + 1),
                     "found damaged YAML: " + printable(error.msg, 120));
  }
  return out;
}

bool has_extension(const fs::path& path, const char* extension) {
  return lower_case(path.extension().string()) == extension;
}

std::unique_ptr<BagReader> open_file(const fs::path& path, bool messages_compressed) {
  const std::string magic = first_bytes(path, kSqliteMagic.size());
  if (magic.compare(0, detail::kMcapMagic.size(), detail::kMcapMagic) == 0) return open_mcap(path);
  if (magic == kSqliteMagic) return std::make_unique<Db3Reader>(path, messages_compressed);
  throw InputError(path.string(), "byte 0",
                   "found " + shown(magic) + ", expected an MCAP file or a database of SQLite");
}

}  // namespace

bool is_recording(const fs::path& path) {
  std::error_code error;
  if (fs::is_directory(path, error)) {
    if (fs::exists(path / "metadata.yaml", error)) return true;
    for (const fs::directory_entry& entry : fs::directory_iterator(path, error)) {
      if (has_extension(entry.path(), ".mcap") || has_extension(entry.path(), ".db3")) return true;
    }
    return false;
  }
  if (!fs::is_regular_file(path, error)) return false;
  if (has_extension(path, ".mcap") || has_extension(path, ".db3")) return true;
  const std::string magic = first_bytes(path, kSqliteMagic.size());
  return magic == kSqliteMagic ||
         magic.compare(0, detail::kMcapMagic.size(), detail::kMcapMagic) == 0;
}

std::unique_ptr<BagReader> open_recording(const fs::path& path) {
  std::error_code error;
  if (!fs::is_directory(path, error)) {
    const fs::path folder = path.parent_path();
    // A file of a folder: whether its messages are compressed stands beside it.
    const bool compressed = has_extension(path, ".db3") &&
                            fs::exists(folder / "metadata.yaml", error) &&
                            read_metadata(folder).messages_compressed;
    return open_file(path, compressed);
  }
  Metadata metadata;
  if (fs::exists(path / "metadata.yaml", error)) metadata = read_metadata(path);
  if (metadata.files.empty()) {
    for (const fs::directory_entry& entry : fs::directory_iterator(path, error)) {
      if (has_extension(entry.path(), ".mcap") || has_extension(entry.path(), ".db3")) {
        metadata.files.push_back(entry.path());
      }
    }
    std::sort(metadata.files.begin(), metadata.files.end());
  }
  if (metadata.files.empty()) {
    throw InputError(path.string(), "found no files that end in .mcap or .db3, expected some");
  }
  std::vector<std::unique_ptr<BagReader>> parts;
  for (const fs::path& file : metadata.files) {
    parts.push_back(open_file(file, metadata.messages_compressed));
  }
  if (parts.size() == 1) return std::move(parts.front());
  return std::make_unique<Joined>(std::move(parts));
}

}  // namespace camber
