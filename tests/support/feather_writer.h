#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

/// Writes Feather (Arrow IPC) files as the Arrow Columnar Format describes them, with FlatBuffers
/// by hand: little-endian, a table's fields before what they refer to.
namespace camber::test {

class FlatBuilder {
 public:
  FlatBuilder() : bytes_(4, '\0') {}  // the place of the root

  /// A table whose field i takes sizes[i] bytes; 0: it is left out.
  /// @return where each field stands, 0 of what is left out.
  std::vector<std::size_t> table(const std::vector<std::size_t>& sizes) {
    std::vector<std::uint16_t> offsets(sizes.size(), 0);
    std::size_t end = 4;
    for (std::size_t i = 0; i < sizes.size(); ++i) {
      if (sizes[i] == 0) continue;
      end = (end + sizes[i] - 1) / sizes[i] * sizes[i];
      offsets[i] = static_cast<std::uint16_t>(end);
      end += sizes[i];
    }
    const std::size_t fields = 4 + 2 * sizes.size();
    while ((bytes_.size() + fields) % 8 != 0) bytes_ += '\0';
    const std::size_t start = bytes_.size() + fields;
    put(static_cast<std::uint16_t>(fields));
    put(static_cast<std::uint16_t>(end));
    for (const std::uint16_t offset : offsets) put(offset);
    put(static_cast<std::int32_t>(fields));
    bytes_.resize(start + end, '\0');
    last_ = start;
    std::vector<std::size_t> out;
    for (const std::uint16_t offset : offsets) out.push_back(offset == 0 ? 0 : start + offset);
    return out;
  }
  std::size_t last_table() const { return last_; }
  template <class T>
  void set(std::size_t place, T value) {
    std::memcpy(bytes_.data() + place, &value, sizeof value);
  }
  template <class T>
  void put(T value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  void refer(std::size_t place, std::size_t to) {
    set(place, static_cast<std::uint32_t>(to - place));
  }
  void text(std::size_t place, const std::string& value) {
    start_list(place, value.size(), 4);
    bytes_ += value;
    bytes_ += '\0';
  }
  /// What follows is a list of `count` elements.
  void start_list(std::size_t place, std::size_t count, std::size_t alignment) {
    while ((bytes_.size() + 4) % alignment != 0 || bytes_.size() % 4 != 0) bytes_ += '\0';
    refer(place, bytes_.size());
    put(static_cast<std::uint32_t>(count));
  }
  /// Room for places of tables. @return the first.
  std::size_t places(std::size_t place, std::size_t count) {
    start_list(place, count, 4);
    bytes_.resize(bytes_.size() + 4 * count, '\0');
    return bytes_.size() - 4 * count;
  }
  std::string padded() const {
    std::string out = bytes_;
    while (out.size() % 8 != 0) out += '\0';
    return out;
  }

 private:
  std::string bytes_;
  std::size_t last_ = 0;
};

struct WrittenColumn {
  std::string name;
  std::variant<std::vector<double>, std::vector<float>, std::vector<std::int64_t>,
               std::vector<std::uint64_t>, std::vector<std::int32_t>, std::vector<std::string>>
      values;
  bool large = false;       // texts with offsets of 64 bits
  bool dictionary = false;  // texts by 8-bit indices
  std::vector<bool> missing = {};
};

struct FeatherWriting {
  int codec = -1;  // of Message.fbs: 0 lz4, 1 zstd; -1: none
  std::function<std::string(std::string_view)> compress = {};
  std::size_t rows_a_batch = 1000;
};

namespace feather {

inline std::size_t rows_of(const WrittenColumn& column) {
  return std::visit([](const auto& values) { return values.size(); }, column.values);
}

template <class T>
std::string raw(const std::vector<T>& values) {
  return std::string(reinterpret_cast<const char*>(values.data()), sizeof(T) * values.size());
}

/// Offsets and bytes of texts.
inline std::pair<std::string, std::string> stored_texts(const std::vector<std::string>& texts,
                                                        bool large) {
  std::vector<std::int32_t> narrow = {0};
  std::vector<std::int64_t> wide = {0};
  std::string bytes;
  for (const std::string& text : texts) {
    bytes += text;
    narrow.push_back(static_cast<std::int32_t>(bytes.size()));
    wide.push_back(static_cast<std::int64_t>(bytes.size()));
  }
  return {large ? raw(wide) : raw(narrow), bytes};
}

inline std::vector<std::string> distinct(const std::vector<std::string>& texts) {
  std::vector<std::string> out;
  for (const std::string& text : texts) {
    if (std::find(out.begin(), out.end(), text) == out.end()) out.push_back(text);
  }
  return out;
}

/// The table of a Schema, into the place of a reference to it.
inline void put_schema(FlatBuilder* flat, std::size_t place,
                       const std::vector<WrittenColumn>& columns) {
  const auto schema = flat->table({2, 4});
  flat->refer(place, flat->last_table());
  const std::size_t list = flat->places(schema[1], columns.size());
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const WrittenColumn& column = columns[i];
    const auto field = flat->table({4, 1, 1, 4, column.dictionary ? 4U : 0U});
    flat->refer(list + 4 * i, flat->last_table());
    flat->text(field[0], column.name);
    flat->set(field[1], std::uint8_t{1});
    struct Put {
      FlatBuilder* flat;
      const std::vector<std::size_t>& field;
      bool large;
      void integer(std::int32_t bits, bool with_sign) const {
        flat->set(field[2], std::uint8_t{2});
        const auto type = flat->table({4, 1});
        flat->refer(field[3], flat->last_table());
        flat->set(type[0], bits);
        flat->set(type[1], static_cast<std::uint8_t>(with_sign));
      }
      void floating(std::int16_t precision) const {
        flat->set(field[2], std::uint8_t{3});
        const auto type = flat->table({2});
        flat->refer(field[3], flat->last_table());
        flat->set(type[0], precision);
      }
      void operator()(const std::vector<double>&) const { floating(2); }
      void operator()(const std::vector<float>&) const { floating(1); }
      void operator()(const std::vector<std::int64_t>&) const { integer(64, true); }
      void operator()(const std::vector<std::uint64_t>&) const { integer(64, false); }
      void operator()(const std::vector<std::int32_t>&) const { integer(32, true); }
      void operator()(const std::vector<std::string>&) const {
        flat->set(field[2], static_cast<std::uint8_t>(large ? 20 : 5));
        flat->table({});
        flat->refer(field[3], flat->last_table());
      }
    };
    std::visit(Put{flat, field, column.large}, column.values);
    if (column.dictionary) {
      const auto dictionary = flat->table({8, 4});
      flat->refer(field[4], flat->last_table());
      flat->set(dictionary[0], static_cast<std::int64_t>(i));
      const auto index = flat->table({4, 1});
      flat->refer(dictionary[1], flat->last_table());
      flat->set(index[0], std::int32_t{8});
      flat->set(index[1], std::uint8_t{1});
    }
  }
}

/// The table of a RecordBatch and its body.
class BatchWriter {
 public:
  BatchWriter(const FeatherWriting& writing, std::size_t rows) : writing_(writing), rows_(rows) {}

  void node(std::size_t missing) { nodes_.push_back(static_cast<std::int64_t>(missing)); }
  void buffer(const std::string& bytes) {
    std::string stored = bytes;
    if (writing_.codec >= 0 && !bytes.empty()) {
      const auto size = static_cast<std::int64_t>(bytes.size());
      const std::string packed = writing_.compress(bytes);
      const bool smaller = packed.size() < bytes.size();
      const std::int64_t stated = smaller ? size : -1;
      stored = std::string(reinterpret_cast<const char*>(&stated), 8) + (smaller ? packed : bytes);
    }
    buffers_.push_back({body_.size(), stored.size()});
    body_ += stored;
    body_.resize((body_.size() + 7) / 8 * 8, '\0');
  }
  void column(const WrittenColumn& column, std::size_t first) {
    std::size_t missing = 0;
    std::string validity;
    if (!column.missing.empty()) {
      validity.assign((rows_ + 7) / 8, '\0');
      for (std::size_t i = 0; i < rows_; ++i) {
        if (column.missing[first + i]) {
          ++missing;
        } else {
          validity[i / 8] = static_cast<char>(validity[i / 8] | (1 << (i % 8)));
        }
      }
    }
    node(missing);
    buffer(validity);
    std::visit([&](const auto& values) { put_values(column, values, first); }, column.values);
  }
  void put(FlatBuilder* flat, std::size_t place) const {
    const auto batch = flat->table({8, 4, 4, writing_.codec >= 0 ? 4U : 0U});
    flat->refer(place, flat->last_table());
    flat->set(batch[0], static_cast<std::int64_t>(rows_));
    flat->start_list(batch[1], nodes_.size(), 8);
    for (const std::int64_t missing : nodes_) {
      flat->put(static_cast<std::int64_t>(rows_));
      flat->put(missing);
    }
    flat->start_list(batch[2], buffers_.size(), 8);
    for (const auto& [offset, length] : buffers_) {
      flat->put(static_cast<std::uint64_t>(offset));
      flat->put(static_cast<std::uint64_t>(length));
    }
    if (writing_.codec < 0) return;
    const auto compression = flat->table({1, 1});
    flat->refer(batch[3], flat->last_table());
    flat->set(compression[0], static_cast<std::int8_t>(writing_.codec));
  }
  const std::string& body() const { return body_; }

 private:
  template <class T>
  void put_values(const WrittenColumn&, const std::vector<T>& values, std::size_t first) {
    const auto from = values.begin() + static_cast<std::ptrdiff_t>(first);
    buffer(raw(std::vector<T>(from, from + static_cast<std::ptrdiff_t>(rows_))));
  }
  void put_values(const WrittenColumn& column, const std::vector<std::string>& values,
                  std::size_t first) {
    const auto from = values.begin() + static_cast<std::ptrdiff_t>(first);
    const std::vector<std::string> part(from, from + static_cast<std::ptrdiff_t>(rows_));
    if (column.dictionary) {
      const std::vector<std::string> known = distinct(values);
      std::vector<std::int8_t> indices;
      for (const std::string& text : part) {
        indices.push_back(
            static_cast<std::int8_t>(std::find(known.begin(), known.end(), text) - known.begin()));
      }
      buffer(raw(indices));
      return;
    }
    const auto [offsets, bytes] = stored_texts(part, column.large);
    buffer(offsets);
    buffer(bytes);
  }

  const FeatherWriting& writing_;
  std::size_t rows_;
  std::vector<std::int64_t> nodes_;
  std::vector<std::pair<std::size_t, std::size_t>> buffers_;
  std::string body_;
};

struct Block {
  std::size_t offset = 0, head = 0, body = 0;
};

/// Appends a message: its mark, length, FlatBuffer and body.
inline Block put_message(const FlatBuilder& flat, const std::string& body, std::string* file) {
  const std::string message = flat.padded();
  Block out{file->size(), 8 + message.size(), body.size()};
  const std::uint32_t head[] = {0xFFFFFFFFU, static_cast<std::uint32_t>(message.size())};
  file->append(reinterpret_cast<const char*>(head), sizeof head);
  *file += message + body;
  return out;
}

/// A Message's table. @return the place of the reference to its header.
inline std::size_t start_message(FlatBuilder* flat, std::uint8_t kind, std::size_t body) {
  const auto message = flat->table({2, 1, 4, 8});
  flat->refer(0, flat->last_table());
  flat->set(message[0], std::int16_t{4});  // of the format, V5
  flat->set(message[1], kind);
  flat->set(message[3], static_cast<std::int64_t>(body));
  return message[2];
}

inline void put_blocks(FlatBuilder* flat, std::size_t place, const std::vector<Block>& blocks) {
  flat->start_list(place, blocks.size(), 8);
  for (const Block& block : blocks) {
    flat->put(static_cast<std::int64_t>(block.offset));
    flat->put(static_cast<std::int32_t>(block.head));
    flat->put(std::int32_t{0});
    flat->put(static_cast<std::int64_t>(block.body));
  }
}

}  // namespace feather

/// The bytes of a file of columns of equal length.
inline std::string feather_bytes(const std::vector<WrittenColumn>& columns,
                                 const FeatherWriting& writing = {}) {
  using namespace feather;
  std::string file("ARROW1\0\0", 8);
  FlatBuilder schema;
  put_schema(&schema, start_message(&schema, 1, 0), columns);
  put_message(schema, "", &file);
  std::vector<Block> dictionaries, batches;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    if (!columns[i].dictionary) continue;
    const auto known = distinct(std::get<std::vector<std::string>>(columns[i].values));
    BatchWriter values(writing, known.size());
    values.column({"", known, columns[i].large}, 0);
    FlatBuilder flat;
    const std::size_t header = start_message(&flat, 2, values.body().size());
    const auto dictionary = flat.table({8, 4});
    flat.refer(header, flat.last_table());
    flat.set(dictionary[0], static_cast<std::int64_t>(i));
    values.put(&flat, dictionary[1]);
    dictionaries.push_back(put_message(flat, values.body(), &file));
  }
  const std::size_t rows = columns.empty() ? 0 : rows_of(columns.front());
  for (std::size_t first = 0; first < rows; first += writing.rows_a_batch) {
    BatchWriter batch(writing, std::min(writing.rows_a_batch, rows - first));
    for (const WrittenColumn& column : columns) batch.column(column, first);
    FlatBuilder flat;
    batch.put(&flat, start_message(&flat, 3, batch.body().size()));
    batches.push_back(put_message(flat, batch.body(), &file));
  }
  FlatBuilder footer;
  const auto places = footer.table({2, 4, 4, 4});
  footer.refer(0, footer.last_table());
  footer.set(places[0], std::int16_t{4});
  put_schema(&footer, places[1], columns);
  put_blocks(&footer, places[2], dictionaries);
  put_blocks(&footer, places[3], batches);
  const std::string bytes = footer.padded();
  file += bytes;
  const auto length = static_cast<std::int32_t>(bytes.size());
  file.append(reinterpret_cast<const char*>(&length), sizeof length);
  return file + "ARROW1";
}

}  // namespace camber::test
