#include "camber/import/formats/feather.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/detail/compressed_bytes.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr std::string_view kMagic = "ARROW1";
constexpr std::string_view kFirstVersion = "FEA1";
constexpr std::size_t kStart = 8;                             // the magic, padded
constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 30;  // of all values
constexpr std::size_t kMostFields = 10000;                    // with those that are nested
constexpr int kMostDepth = 64;

/// A part of a file. Numbers are little-endian.
class Bytes {
 public:
  Bytes(const std::string& file, std::string_view data, std::uint64_t start)
      : file_(file), data_(data), start_(start) {}

  std::uint64_t size() const { return data_.size(); }
  const std::string& file() const { return file_; }
  [[noreturn]] void fail(std::uint64_t at, const std::string& reason) const {
    throw InputError(file_, fmt::format("byte {}", start_ + at), reason);
  }
  Bytes part(std::uint64_t at, std::uint64_t count, const char* what) const {
    if (at > size() || count > size() - at) {
      fail(std::min(at, size()),
           fmt::format("found {} bytes to the end of the part, expected {} of {}",
                       size() - std::min(at, size()), count, what));
    }
    return {file_, data_.substr(at, count), start_ + at};
  }
  template <class T>
  T number(std::uint64_t at, const char* what) const {
    T out;
    std::memcpy(&out, part(at, sizeof(T), what).data_.data(), sizeof(T));
    return out;
  }
  std::string_view view() const { return data_; }
  std::uint64_t place(std::uint64_t at) const { return start_ + at; }

 private:
  const std::string& file_;
  std::string_view data_;
  std::uint64_t start_;  // in the file
};

/// A table of a FlatBuffer: its fields by their numbers in the schema.
class Flat {
 public:
  Flat(const Bytes& bytes, std::uint64_t at) : bytes_(bytes), at_(at) {
    const auto back = bytes_.number<std::int32_t>(at, "a table");
    const auto fields = static_cast<std::int64_t>(at) - back;
    if (fields < 0) bytes_.fail(at, "found a table whose fields lie outside the message");
    fields_ = static_cast<std::uint64_t>(fields);
    end_ = bytes_.number<std::uint16_t>(fields_, "a table's fields");
    bytes_.part(fields_, end_, "a table's fields");
  }
  static Flat root(const Bytes& bytes) {
    return {bytes, bytes.number<std::uint32_t>(0, "a message")};
  }

  template <class T>
  T scalar(unsigned field, T otherwise) const {
    const std::uint64_t place = place_of(field);
    return place == 0 ? otherwise : bytes_.number<T>(place, "a value");
  }
  std::optional<Flat> table(unsigned field) const {
    const std::uint64_t place = place_of(field);
    if (place == 0) return std::nullopt;
    return Flat(bytes_, referred(place));
  }
  std::string text(unsigned field) const {
    const std::uint64_t place = place_of(field);
    if (place == 0) return {};
    const std::uint64_t at = referred(place);
    const auto length = bytes_.number<std::uint32_t>(at, "a text");
    return std::string(bytes_.part(at + 4, length, "a text").view());
  }
  struct Vector {
    std::uint64_t first = 0, count = 0;
  };
  /// @param size  bytes of an element.
  Vector vector(unsigned field, std::uint64_t size) const {
    const std::uint64_t place = place_of(field);
    if (place == 0) return {};
    const std::uint64_t at = referred(place);
    const auto count = bytes_.number<std::uint32_t>(at, "a list");
    bytes_.part(at + 4, count * size, "a list");
    return {at + 4, count};
  }
  /// Element of a vector of tables.
  Flat element(const Vector& vector, std::uint64_t i) const {
    return {bytes_, referred(vector.first + 4 * i)};
  }
  const Bytes& bytes() const { return bytes_; }
  [[noreturn]] void fail(const std::string& reason) const { bytes_.fail(at_, reason); }

 private:
  std::uint64_t place_of(unsigned field) const {
    const std::uint64_t slot = 4 + 2 * std::uint64_t{field};
    if (slot + 2 > end_) return 0;
    const auto offset = bytes_.number<std::uint16_t>(fields_ + slot, "a table's fields");
    return offset == 0 ? 0 : at_ + offset;
  }
  std::uint64_t referred(std::uint64_t place) const {
    return place + bytes_.number<std::uint32_t>(place, "a place");
  }

  Bytes bytes_;
  std::uint64_t at_, fields_ = 0, end_ = 0;
};

// Numbers of the union Type of Schema.fbs.
enum class TypeId : std::uint8_t {
  kNone = 0,
  kNull = 1,
  kInt = 2,
  kFloat = 3,
  kBinary = 4,
  kUtf8 = 5,
  kBool = 6,
  kDecimal = 7,
  kDate = 8,
  kTime = 9,
  kTimestamp = 10,
  kInterval = 11,
  kList = 12,
  kStruct = 13,
  kFixedBinary = 15,
  kFixedList = 16,
  kMap = 17,
  kDuration = 18,
  kLargeBinary = 19,
  kLargeUtf8 = 20,
  kLargeList = 21,
};

using Kind = FeatherColumn::Kind;

/// How the values of one type are stored.
struct Type {
  std::string name;
  Kind kind = Kind::kOther;
  int bits = 0;  // of a value, or of an offset into the texts
  bool is_signed = true;
  int buffers = 0;  // of the column itself, with its validity
};

struct Field {
  std::string name;
  Type type;
  std::optional<std::int64_t> dictionary;  // its number
  Type index;                              // into the dictionary
  std::vector<Field> children;
};

Type integer_type(const Flat& integer) {
  Type out;
  out.bits = integer.scalar<std::int32_t>(0, 0);
  out.is_signed = integer.scalar<std::uint8_t>(1, 0) != 0;
  if (out.bits != 8 && out.bits != 16 && out.bits != 32 && out.bits != 64) {
    integer.fail(fmt::format("found integers of {} bits, expected 8, 16, 32 or 64", out.bits));
  }
  out.name = fmt::format("{}int{}", out.is_signed ? "" : "u", out.bits);
  out.kind = out.bits == 64 && !out.is_signed ? Kind::kUnsigned : Kind::kInteger;
  out.buffers = 2;
  return out;
}

Type type_of(const Flat& field) {
  const auto id = static_cast<TypeId>(field.scalar<std::uint8_t>(2, 0));
  const std::optional<Flat> type = field.table(3);
  if (!type) field.fail("found a column without a type");
  const auto unit = [&](std::int16_t otherwise) {
    return type->scalar<std::int16_t>(0, otherwise);
  };
  switch (id) {
    case TypeId::kNull:
      return {"null", Kind::kOther, 0, true, 0};
    case TypeId::kInt:
      return integer_type(*type);
    case TypeId::kFloat: {
      const std::int16_t precision = unit(0);
      if (precision < 0 || precision > 2) {
        type->fail(fmt::format("found a precision {}, expected 0, 1 or 2", precision));
      }
      static constexpr const char* kNames[] = {"half", "float", "double"};
      return {kNames[precision], Kind::kNumber, 16 << precision, true, 2};
    }
    case TypeId::kBool:
      return {"bool", Kind::kInteger, 1, false, 2};
    case TypeId::kDate:
      return {"date", Kind::kInteger, unit(1) == 0 ? 32 : 64, true, 2};
    case TypeId::kTime: {
      const auto bits = type->scalar<std::int32_t>(1, 32);
      if (bits != 32 && bits != 64) type->fail("found times of neither 32 nor 64 bits");
      return {"time", Kind::kInteger, bits, true, 2};
    }
    case TypeId::kTimestamp:
      return {"timestamp", Kind::kInteger, 64, true, 2};
    case TypeId::kDuration:
      return {"duration", Kind::kInteger, 64, true, 2};
    case TypeId::kUtf8:
      return {"utf8", Kind::kText, 32, true, 3};
    case TypeId::kLargeUtf8:
      return {"large_utf8", Kind::kText, 64, true, 3};
    case TypeId::kBinary:
    case TypeId::kLargeBinary:
      return {"binary", Kind::kOther, 0, true, 3};
    case TypeId::kFixedBinary:
      return {"fixed_size_binary", Kind::kOther, 0, true, 2};
    case TypeId::kDecimal:
      return {"decimal", Kind::kOther, 0, true, 2};
    case TypeId::kInterval:
      return {"interval", Kind::kOther, 0, true, 2};
    case TypeId::kList:
    case TypeId::kLargeList:
      return {"list", Kind::kOther, 0, true, 2};
    case TypeId::kMap:
      return {"map", Kind::kOther, 0, true, 2};
    case TypeId::kStruct:
      return {"struct", Kind::kOther, 0, true, 1};
    case TypeId::kFixedList:
      return {"fixed_size_list", Kind::kOther, 0, true, 1};
    case TypeId::kNone:
      break;
  }
  field.fail(
      fmt::format("found a column of the type {}, which is not known", static_cast<int>(id)));
}

/// Fields of a schema, or children of a field.
std::vector<Field> fields_of(const Flat& owner, unsigned number, int depth, std::size_t* count) {
  if (depth > kMostDepth) owner.fail("found columns that are nested too deeply");
  const Flat::Vector listed = owner.vector(number, 4);
  *count += listed.count;
  if (*count > kMostFields) owner.fail("found more than 10000 columns");
  std::vector<Field> out;
  for (std::uint64_t i = 0; i < listed.count; ++i) {
    const Flat field = owner.element(listed, i);
    Field column;
    column.name = field.text(0);
    column.type = type_of(field);
    if (const auto dictionary = field.table(4)) {
      column.dictionary = dictionary->scalar<std::int64_t>(0, 0);
      const auto index = dictionary->table(1);
      column.index = index ? integer_type(*index) : Type{"int32", Kind::kInteger, 32, true, 2};
    }
    column.children = fields_of(field, 5, depth + 1, count);
    out.push_back(std::move(column));
  }
  return out;
}

double from_half(std::uint16_t half) {
  const int exponent = half >> 10 & 31, fraction = half & 1023;
  const double magnitude = exponent == 0   ? std::ldexp(fraction, -24)
                           : exponent < 31 ? std::ldexp(1024 + fraction, exponent - 25)
                           : fraction == 0 ? std::numeric_limits<double>::infinity()
                                           : std::numeric_limits<double>::quiet_NaN();
  return half >> 15 != 0 ? -magnitude : magnitude;
}

/// Values of one column of one batch, or of a dictionary.
struct Values {
  std::vector<std::int64_t> integers;
  std::vector<std::uint64_t> unsigneds;
  std::vector<double> numbers;
  std::vector<std::string> texts;
  std::vector<std::uint8_t> missing;
};

/// The columns of a record batch, one after the other.
class Batch {
 public:
  /// @param left  bytes that the file's values may still take.
  Batch(const Flat& batch, const Bytes& body, std::uint64_t* left)
      : batch_(batch), body_(body), left_(left) {
    rows_ = batch.scalar<std::int64_t>(0, 0);
    if (rows_ < 0) batch.fail(fmt::format("found a batch of {} rows", rows_));
    nodes_ = batch.vector(1, 16);
    buffers_ = batch.vector(2, 16);
    if (const auto compression = batch.table(3)) {
      const auto codec = compression->scalar<std::int8_t>(0, 0);
      const auto method = compression->scalar<std::int8_t>(1, 0);
      if ((codec != 0 && codec != 1) || method != 0) {
        compression->fail(
            fmt::format("found the compression {} by the method {}, expected lz4 (0) or zstd (1) "
                        "by buffers (0)",
                        codec, method));
      }
      codec_ = codec == 0 ? "lz4" : "zstd";
    }
  }

  std::int64_t rows() const { return rows_; }

  /// The next column. Nothing of what is not read.
  Values column(const Field& field, bool of_dictionary) {
    const Node node = next_node();
    if (node.length != rows_) {
      batch_.fail(fmt::format("found a column '{}' of {} rows in a batch of {}",
                              printable(field.name), node.length, rows_));
    }
    const Type& type = field.dictionary && !of_dictionary ? field.index : field.type;
    if (type.kind == Kind::kOther) {
      skip(field);
      return {};
    }
    Values out;
    const auto rows = static_cast<std::uint64_t>(rows_);
    const std::string validity = next_buffer();
    const std::string first = next_buffer();
    const std::string bytes = type.kind == Kind::kText ? next_buffer() : std::string();
    if (type.kind == Kind::kText) {
      take_texts(type, first, bytes, &out);
    } else {
      require(first, type.bits == 1 ? (rows + 7) / 8 : bytes_for(rows, type.bits), field);
      take_numbers(type, first, &out);
    }
    if (node.nulls > 0) take_missing(validity, field, &out);
    return out;
  }

 private:
  struct Node {
    std::int64_t length, nulls;
  };

  Node next_node() {
    if (node_ == nodes_.count) batch_.fail("found fewer columns in a batch than in the schema");
    const std::uint64_t at = nodes_.first + 16 * node_++;
    return {batch_.bytes().number<std::int64_t>(at, "a column"),
            batch_.bytes().number<std::int64_t>(at + 8, "a column")};
  }

  /// @return its place among the batch's buffers.
  std::uint64_t pass_buffer() {
    if (buffer_ == buffers_.count)
      batch_.fail("found fewer buffers in a batch than its columns have");
    return buffers_.first + 16 * buffer_++;
  }

  void spend(std::uint64_t bytes) {
    if (bytes > *left_) {
      batch_.fail(fmt::format("found values of more than {} bytes", kMostBytes));
    }
    *left_ -= bytes;
  }

  std::string next_buffer() {
    const std::uint64_t at = pass_buffer();
    const auto offset = batch_.bytes().number<std::uint64_t>(at, "a buffer");
    const auto length = batch_.bytes().number<std::uint64_t>(at + 8, "a buffer");
    if (length == 0) return {};
    const Bytes stored = body_.part(offset, length, "a buffer");
    if (codec_ == nullptr) {
      spend(length);
      return std::string(stored.view());
    }
    const auto size = stored.number<std::int64_t>(0, "a compressed buffer");
    const Bytes rest = stored.part(8, length - 8, "a compressed buffer");
    if (size == -1) {  // it would not have become smaller
      spend(rest.size());
      return std::string(rest.view());
    }
    if (size < 0) stored.fail(0, fmt::format("found a buffer of {} bytes", size));
    spend(static_cast<std::uint64_t>(size));
    return detail::uncompress_block(codec_, rest.view(), static_cast<std::uint64_t>(size),
                                    body_.file(), fmt::format("byte {}", rest.place(0)));
  }

  /// Bytes of so many values; of more than can be: that of all that can.
  static std::uint64_t bytes_for(std::uint64_t values, int bits) {
    const auto each = static_cast<std::uint64_t>(bits) / 8;
    return values > kMostBytes ? std::numeric_limits<std::uint64_t>::max() : values * each;
  }

  void require(const std::string& buffer, std::uint64_t bytes, const Field& field) const {
    if (buffer.size() >= bytes) return;
    batch_.fail(fmt::format("found {} bytes of the column '{}', expected those of {} rows",
                            buffer.size(), printable(field.name), rows_));
  }

  void skip(const Field& field) {
    for (int i = 0; i < field.type.buffers; ++i) pass_buffer();
    for (const Field& child : field.children) {
      next_node();
      if (child.dictionary) {
        pass_buffer();
        pass_buffer();
      } else {
        skip(child);
      }
    }
  }

  template <class T, class Out>
  static void append(const std::string& from, std::uint64_t rows, std::vector<Out>* to) {
    to->resize(rows);
    for (std::uint64_t i = 0; i < rows; ++i) {
      T value;
      std::memcpy(&value, from.data() + sizeof(T) * i, sizeof(T));
      (*to)[i] = static_cast<Out>(value);
    }
  }

  void take_numbers(const Type& type, const std::string& from, Values* out) {
    const auto rows = static_cast<std::uint64_t>(rows_);
    spend(8 * rows);
    if (type.kind == Kind::kUnsigned) {
      append<std::uint64_t>(from, rows, &out->unsigneds);
    } else if (type.kind == Kind::kNumber) {
      if (type.bits == 16) {
        out->numbers.resize(rows);
        for (std::uint64_t i = 0; i < rows; ++i) {
          std::uint16_t half;
          std::memcpy(&half, from.data() + 2 * i, 2);
          out->numbers[i] = from_half(half);
        }
      } else if (type.bits == 32) {
        append<float>(from, rows, &out->numbers);
      } else {
        append<double>(from, rows, &out->numbers);
      }
    } else if (type.bits == 1) {
      out->integers.resize(rows);
      for (std::uint64_t i = 0; i < rows; ++i) out->integers[i] = bit(from, i);
    } else if (type.is_signed) {
      switch (type.bits) {
        case 8:
          append<std::int8_t>(from, rows, &out->integers);
          break;
        case 16:
          append<std::int16_t>(from, rows, &out->integers);
          break;
        case 32:
          append<std::int32_t>(from, rows, &out->integers);
          break;
        default:
          append<std::int64_t>(from, rows, &out->integers);
      }
    } else {
      switch (type.bits) {
        case 8:
          append<std::uint8_t>(from, rows, &out->integers);
          break;
        case 16:
          append<std::uint16_t>(from, rows, &out->integers);
          break;
        default:
          append<std::uint32_t>(from, rows, &out->integers);
      }
    }
  }

  void take_texts(const Type& type, const std::string& offsets, const std::string& bytes,
                  Values* out) {
    if (rows_ == 0) return;  // the only offset may be left out
    const auto rows = static_cast<std::uint64_t>(rows_);
    const std::uint64_t each = type.bits == 32 ? 4 : 8;
    if (offsets.size() / each <= rows) {
      batch_.fail(fmt::format("found {} bytes of offsets of texts, expected those of {} rows",
                              offsets.size(), rows));
    }
    spend(sizeof(std::string) * rows);
    const auto offset = [&](std::uint64_t i) -> std::int64_t {
      if (each == 4) {
        std::int32_t value;
        std::memcpy(&value, offsets.data() + 4 * i, 4);
        return value;
      }
      std::int64_t value;
      std::memcpy(&value, offsets.data() + 8 * i, 8);
      return value;
    };
    out->texts.reserve(rows);
    std::int64_t from = offset(0);
    for (std::uint64_t i = 0; i < rows; ++i) {
      const std::int64_t to = offset(i + 1);
      if (from < 0 || to < from || static_cast<std::uint64_t>(to) > bytes.size()) {
        batch_.fail(fmt::format("found a text from {} to {} of {} bytes", from, to, bytes.size()));
      }
      out->texts.push_back(
          bytes.substr(static_cast<std::size_t>(from), static_cast<std::size_t>(to - from)));
      from = to;
    }
  }

  static std::uint8_t bit(const std::string& bits, std::uint64_t i) {
    return static_cast<std::uint8_t>(static_cast<std::uint8_t>(bits[i / 8]) >> (i % 8) & 1);
  }

  void take_missing(const std::string& validity, const Field& field, Values* out) {
    const auto rows = static_cast<std::uint64_t>(rows_);
    require(validity, (rows + 7) / 8, field);
    out->missing.resize(rows);
    for (std::uint64_t i = 0; i < rows; ++i) {
      out->missing[i] = bit(validity, i) == 0;
      if (!out->missing[i]) continue;
      if (!out->integers.empty()) out->integers[i] = 0;
      if (!out->unsigneds.empty()) out->unsigneds[i] = 0;
      if (!out->numbers.empty()) out->numbers[i] = std::numeric_limits<double>::quiet_NaN();
      if (!out->texts.empty()) out->texts[i].clear();
    }
  }

  Flat batch_;
  Bytes body_;
  std::uint64_t* left_;
  std::int64_t rows_ = 0;
  Flat::Vector nodes_, buffers_;
  std::uint64_t node_ = 0, buffer_ = 0;
  const char* codec_ = nullptr;
};

template <class T>
void append(std::vector<T> from, std::vector<T>* to) {
  if (to->empty()) {
    *to = std::move(from);
  } else {
    to->insert(to->end(), std::make_move_iterator(from.begin()),
               std::make_move_iterator(from.end()));
  }
}

/// @param before, rows  of the list that values are added to, and how many
void append(Values from, std::size_t before, std::size_t rows, Values* to) {
  append(std::move(from.integers), &to->integers);
  append(std::move(from.unsigneds), &to->unsigneds);
  append(std::move(from.numbers), &to->numbers);
  append(std::move(from.texts), &to->texts);
  if (from.missing.empty() && to->missing.empty()) return;
  to->missing.resize(before);
  if (from.missing.empty()) from.missing.resize(rows);
  append(std::move(from.missing), &to->missing);
}

struct Dictionary {
  Values values;
  std::size_t size = 0;
};

class Reader {
 public:
  Reader(std::string bytes, std::string name)
      : file_(std::move(name)), text_(std::move(bytes)), whole_(file_, text_, 0) {}

  FeatherTable read() {
    if (text_.compare(0, kFirstVersion.size(), kFirstVersion) == 0) {
      whole_.fail(0,
                  "found a Feather file of version 1, expected version 2 (write it again by a "
                  "newer program)");
    }
    if (text_.compare(0, kMagic.size(), kMagic) != 0) {
      whole_.fail(0, "found '" + printable(std::string_view(text_).substr(0, 8)) +
                         "', expected a Feather (Apache Arrow) file");
    }
    constexpr std::uint64_t kEnd = 4 + kMagic.size();  // length of the footer, magic
    if (text_.size() < kStart + kEnd ||
        text_.compare(text_.size() - kMagic.size(), kMagic.size(), kMagic) != 0) {
      whole_.fail(text_.size(), "found the end of the file, expected 'ARROW1' there (is it cut?)");
    }
    const std::uint64_t end = text_.size() - kEnd;
    const auto length = whole_.number<std::int32_t>(end, "the footer's length");
    if (length <= 0 || static_cast<std::uint64_t>(length) > end - kStart) {
      whole_.fail(
          end, fmt::format("found a footer of {} bytes, expected 1 to {}", length, end - kStart));
    }
    data_end_ = end - static_cast<std::uint64_t>(length);
    const Flat footer =
        Flat::root(whole_.part(data_end_, static_cast<std::uint64_t>(length), "the footer"));
    const std::optional<Flat> schema = footer.table(1);
    if (!schema) footer.fail("found no schema, expected one");
    if (schema->scalar<std::int16_t>(0, 0) != 0) {
      schema->fail("found big-endian numbers, expected little-endian ones");
    }
    std::size_t count = 0;
    fields_ = fields_of(*schema, 1, 0, &count);
    FeatherTable out;
    for (const Field& field : fields_) {
      FeatherColumn& column = out.columns.emplace_back();
      column.name = field.name;
      column.kind = field.type.kind;
      column.type = field.dictionary ? "dictionary of " + field.type.name : field.type.name;
    }
    for_blocks(footer, 2,
               [&](const Flat& message, const Bytes& body) { read_dictionary(message, body); });
    std::vector<Values> values(fields_.size());
    for_blocks(footer, 3, [&](const Flat& message, const Bytes& body) {
      out.rows += read_batch(message, body, out.rows, &values);
    });
    for (std::size_t i = 0; i < values.size(); ++i) {
      FeatherColumn& column = out.columns[i];
      column.integers = std::move(values[i].integers);
      column.unsigneds = std::move(values[i].unsigneds);
      column.numbers = std::move(values[i].numbers);
      column.texts = std::move(values[i].texts);
      if (column.kind != Kind::kOther) column.missing = std::move(values[i].missing);
    }
    return out;
  }

 private:
  /// The messages that a list of the footer names.
  void for_blocks(const Flat& footer, unsigned field,
                  const std::function<void(const Flat&, const Bytes&)>& take) {
    constexpr std::uint64_t kBlock = 24;
    const Flat::Vector blocks = footer.vector(field, kBlock);
    for (std::uint64_t i = 0; i < blocks.count; ++i) {
      const std::uint64_t at = blocks.first + kBlock * i;
      const auto offset = footer.bytes().number<std::uint64_t>(at, "a block");
      const auto head = footer.bytes().number<std::int32_t>(at + 8, "a block");
      const auto size = footer.bytes().number<std::uint64_t>(at + 16, "a block");
      if (offset < kStart || offset > data_end_ || head < 8 ||
          static_cast<std::uint64_t>(head) > data_end_ - offset ||
          size > data_end_ - offset - static_cast<std::uint64_t>(head)) {
        footer.bytes().fail(at, fmt::format("found a block of {} + {} bytes at {}, expected it "
                                            "between the bytes {} and {}",
                                            head, size, offset, kStart, data_end_));
      }
      const Bytes block = whole_.part(offset, static_cast<std::uint64_t>(head), "a message");
      // Before Arrow 0.15 no mark stood before the length.
      const bool marked = block.number<std::uint32_t>(0, "a message") == 0xFFFFFFFFU;
      const std::uint64_t start = marked ? 8 : 4;
      const auto length = block.number<std::uint32_t>(start - 4, "a message's length");
      const Flat message = Flat::root(block.part(start, length, "a message"));
      take(message, whole_.part(offset + static_cast<std::uint64_t>(head), size, "a body"));
    }
  }

  static Flat header(const Flat& message, std::uint8_t kind, const char* what) {
    const auto found = message.scalar<std::uint8_t>(1, 0);
    const std::optional<Flat> header = message.table(2);
    if (found != kind || !header) {
      message.fail(
          fmt::format("found a message of the kind {}, expected {} ({})", found, kind, what));
    }
    return *header;
  }

  void read_dictionary(const Flat& message, const Bytes& body) {
    const Flat found = header(message, 2, "a dictionary");
    const auto id = found.scalar<std::int64_t>(0, 0);
    const std::optional<Flat> data = found.table(1);
    if (!data) found.fail("found a dictionary without values");
    const auto field = std::find_if(fields_.begin(), fields_.end(),
                                    [&](const Field& f) { return f.dictionary == id; });
    if (field == fields_.end() || field->type.kind == Kind::kOther) return;  // of what is not read
    Batch batch(*data, body, &left_);
    Values values = batch.column(*field, true);
    Dictionary& dictionary = dictionaries_[id];
    const bool added = found.scalar<std::uint8_t>(2, 0) != 0;
    if (!added) dictionary = {};
    const auto rows = static_cast<std::size_t>(batch.rows());
    append(std::move(values), dictionary.size, rows, &dictionary.values);
    dictionary.size += rows;
  }

  /// The values that indices stand for.
  Values looked_up(const Field& field, const Flat& message, Values indices, std::size_t rows) {
    Values out;
    const auto found = dictionaries_.find(*field.dictionary);
    const Values* from = found == dictionaries_.end() ? nullptr : &found->second.values;
    const std::size_t size = from == nullptr ? 0 : found->second.size;
    const bool texts = field.type.kind == Kind::kText;
    if (texts) out.texts.resize(rows);
    if (field.type.kind == Kind::kInteger) out.integers.resize(rows);
    if (field.type.kind == Kind::kUnsigned) out.unsigneds.resize(rows);
    if (field.type.kind == Kind::kNumber) {
      out.numbers.resize(rows, std::numeric_limits<double>::quiet_NaN());
    }
    out.missing = std::move(indices.missing);
    for (std::size_t i = 0; i < rows; ++i) {
      if (!out.missing.empty() && out.missing[i] != 0) continue;
      const std::uint64_t index = indices.unsigneds.empty()
                                      ? static_cast<std::uint64_t>(indices.integers[i])
                                      : indices.unsigneds[i];
      if (index >= size) {
        message.fail(fmt::format("found the value {} of the dictionary of '{}', which has {}",
                                 index, printable(field.name), size));
      }
      if (!from->missing.empty() && from->missing[index] != 0) {
        if (out.missing.empty()) out.missing.resize(rows);
        out.missing[i] = 1;
      } else if (texts) {
        spend(message, from->texts[index].size());
        out.texts[i] = from->texts[index];
      } else if (field.type.kind == Kind::kInteger) {
        out.integers[i] = from->integers[index];
      } else if (field.type.kind == Kind::kUnsigned) {
        out.unsigneds[i] = from->unsigneds[index];
      } else {
        out.numbers[i] = from->numbers[index];
      }
    }
    return out;
  }

  std::size_t read_batch(const Flat& message, const Bytes& body, std::size_t before,
                         std::vector<Values>* values) {
    const Flat found = header(message, 3, "a batch of rows");
    Batch batch(found, body, &left_);
    const auto rows = static_cast<std::size_t>(batch.rows());
    if (rows > std::numeric_limits<std::size_t>::max() / 4 - before) {
      found.fail(fmt::format("found a batch of {} rows", rows));
    }
    for (std::size_t i = 0; i < fields_.size(); ++i) {
      const Field& field = fields_[i];
      Values column = batch.column(field, false);
      if (field.type.kind == Kind::kOther) continue;
      if (field.dictionary) {
        spend(found, sizeof(std::string) * rows);
        column = looked_up(field, found, std::move(column), rows);
      }
      append(std::move(column), before, rows, &(*values)[i]);
    }
    return rows;
  }

  void spend(const Flat& at, std::uint64_t bytes) {
    if (bytes > left_) at.fail(fmt::format("found values of more than {} bytes", kMostBytes));
    left_ -= bytes;
  }

  std::string file_, text_;
  Bytes whole_;
  std::uint64_t data_end_ = 0;
  std::uint64_t left_ = kMostBytes;
  std::vector<Field> fields_;
  std::map<std::int64_t, Dictionary> dictionaries_;
};

}  // namespace

std::string FeatherColumn::text(std::size_t row) const {
  if (!missing.empty() && missing[row] != 0) return {};
  switch (kind) {
    case Kind::kInteger:
      return fmt::format("{}", integers[row]);
    case Kind::kUnsigned:
      return fmt::format("{}", unsigneds[row]);
    case Kind::kNumber:
      return fmt::format("{}", numbers[row]);
    case Kind::kText:
      return texts[row];
    case Kind::kOther:
      break;
  }
  return {};
}

bool is_feather(std::string_view bytes) {
  return bytes.substr(0, kMagic.size()) == kMagic ||
         bytes.substr(0, kFirstVersion.size()) == kFirstVersion;
}

bool is_feather(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  char first[6] = {};
  file.read(first, sizeof first);
  return is_feather(std::string_view(first, static_cast<std::size_t>(file.gcount())));
}

FeatherTable read_feather(const fs::path& path) {
  return read_feather(read_whole_file(path), path.string());
}

FeatherTable read_feather(std::string bytes, const std::string& name) {
  return Reader(std::move(bytes), name).read();
}

}  // namespace camber
