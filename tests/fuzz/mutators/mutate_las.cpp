#include <algorithm>
#include <vector>

#include "fuzz/mutators/mutator.h"

namespace camber::fuzz {
namespace {

// ASPRS LAS 1.4 R15: places in the header, and of a variable length record (VLR).
constexpr std::size_t kHeaderSizeAt = 94, kPointsAt = 96, kRecordsAt = 100, kFormatAt = 104,
                      kPointSizeAt = 105, kLegacyCountAt = 107, kLeastHeader = 227, kHeader14 = 375,
                      kExtendedAt = 235, kExtendedCountAt = 243, kCountAt = 247, kRecordHeader = 54,
                      kRecordLengthAt = 20;

struct Field {
  std::size_t at;
  int width;
  bool real = false;
};

constexpr Field kFields[] = {{6, 2},
                             {24, 1},
                             {25, 1},
                             {kHeaderSizeAt, 2},
                             {kPointsAt, 4},
                             {kRecordsAt, 4},
                             {kFormatAt, 1},
                             {kPointSizeAt, 2},
                             {kLegacyCountAt, 4},
                             {111, 4},
                             {131, 8, true},
                             {139, 8, true},
                             {147, 8, true},
                             {155, 8, true},
                             {163, 8, true},
                             {171, 8, true},
                             {179, 8, true},
                             {187, 8, true},
                             {219, 8, true},
                             {227, 8},
                             {kExtendedAt, 8},
                             {kExtendedCountAt, 4},
                             {kCountAt, 8},
                             {255, 8}};

void change_field(std::string* las, Dice& dice) {
  const Field field = kFields[dice.below(std::size(kFields))];
  if (field.at + static_cast<std::size_t>(field.width) > las->size()) return;
  const std::uint64_t old = get_number(*las, field.at, field.width);
  std::uint64_t now = odd_integer(old, field.width, dice);
  if (field.real && dice.one_in(2)) {
    double value = 0.0;
    static_assert(sizeof value == sizeof now);
    std::copy_n(reinterpret_cast<const char*>(&old), sizeof old, reinterpret_cast<char*>(&value));
    value = odd_double(value, dice);
    std::copy_n(reinterpret_cast<const char*>(&value), sizeof now, reinterpret_cast<char*>(&now));
  }
  set_number(las, field.at, field.width, now);
}

/// Where the variable length records begin, of which size; nothing where they do not fit.
struct Record {
  std::size_t at, size;  // size with its header
};

std::vector<Record> records_of(std::string_view las) {
  std::vector<Record> out;
  std::size_t at = get_number(las, kHeaderSizeAt, 2);
  for (std::uint64_t left = get_number(las, kRecordsAt, 4); left > 0; --left) {
    if (at + kRecordHeader > las.size()) break;
    const std::size_t size = kRecordHeader + get_number(las, at + kRecordLengthAt, 2);
    if (at + size > las.size()) break;
    out.push_back({at, size});
    at += size;
  }
  return out;
}

/// What lies behind `at` moved by `by` bytes: the offsets follow.
void move_offsets(std::string* las, std::size_t at, std::int64_t by) {
  const auto follow = [&](std::size_t place, int width) {
    const std::uint64_t old = get_number(*las, place, width);
    if (old >= at) set_number(las, place, width, old + static_cast<std::uint64_t>(by));
  };
  follow(kPointsAt, 4);
  const std::size_t header = get_number(*las, kHeaderSizeAt, 2);
  if (header >= kHeader14 && las->size() >= kHeader14) follow(kExtendedAt, 8);
}

/// A further record, of a kind that readers look for, behind the others.
void add_record(std::string* las, Dice& dice) {
  struct Kind {
    const char* user;
    int number;
    std::size_t length;  // of an element of what it holds
  };
  static const std::array<Kind, 8> kKinds{{{"LASF_Projection", 34735, 8},
                                           {"LASF_Projection", 34736, 8},
                                           {"LASF_Projection", 34737, 1},
                                           {"LASF_Projection", 2112, 1},
                                           {"LASF_Projection", 2111, 1},
                                           {"LASF_Spec", 0, 16},
                                           {"LASF_Spec", 4, 192},
                                           {"LASF_Spec", 100, 26}}};
  const std::vector<Record> records = records_of(*las);
  const std::size_t at = records.empty() ? get_number(*las, kHeaderSizeAt, 2)
                                         : records.back().at + records.back().size;
  if (at > las->size()) return;
  const Kind& kind = dice.of(kKinds);
  std::string content(kind.length * dice.below(12), '\0');
  for (char& byte : content) {
    byte = static_cast<char>(kind.length == 1 ? ' ' + dice.below(95) : odd_integer(1, 1, dice));
  }
  std::string record(kRecordHeader, '\0');
  record.replace(2, std::string_view(kind.user).size(), kind.user);
  set_number(&record, 18, 2, static_cast<std::uint64_t>(kind.number));
  set_number(&record, kRecordLengthAt, 2, content.size());
  record += content;
  las->insert(at, record);
  set_number(las, kRecordsAt, 4, get_number(*las, kRecordsAt, 4) + 1);
  move_offsets(las, at, static_cast<std::int64_t>(record.size()));
}

void change_record(std::string* las, Dice& dice, const ByteMutation& bytes) {
  const std::vector<Record> records = records_of(*las);
  if (records.empty() || dice.one_in(5)) return add_record(las, dice);
  const Record record = records[dice.below(records.size())];
  const std::uint64_t count = get_number(*las, kRecordsAt, 4);
  const auto size = static_cast<std::int64_t>(record.size);
  switch (dice.below(6)) {
    case 0: {  // twice
      const std::string copy = las->substr(record.at, record.size);
      las->insert(record.at + record.size, copy);
      set_number(las, kRecordsAt, 4, count + 1);
      move_offsets(las, record.at + record.size, size);
      break;
    }
    case 1:
      las->erase(record.at, record.size);
      set_number(las, kRecordsAt, 4, count - 1);
      move_offsets(las, record.at + record.size, -size);
      break;
    case 2: {  // user or number
      const std::size_t at = record.at + 2 + dice.below(18);
      set_number(las, at, 1, odd_integer(get_number(*las, at, 1), 1, dice));
      break;
    }
    case 3: {  // what it holds, of another length
      const std::size_t from = record.at + kRecordHeader, length = record.size - kRecordHeader;
      std::string content = bytes(std::string_view(*las).substr(from, length), length + 200);
      content.resize(std::min<std::size_t>(content.size(), 65535));
      las->replace(from, length, content);
      set_number(las, record.at + kRecordLengthAt, 2, content.size());
      move_offsets(las, from + length,
                   static_cast<std::int64_t>(content.size()) - static_cast<std::int64_t>(length));
      break;
    }
    default: {  // a number of what it holds: keys of GeoTIFF are of 2 bytes, coordinates of 8
      const int width = 1 << dice.below(4);
      const std::size_t length = record.size - kRecordHeader;
      if (length < static_cast<std::size_t>(width)) return;
      std::size_t at = dice.below(length - static_cast<std::size_t>(width) + 1);
      if (dice.one_in(2)) at -= at % static_cast<std::size_t>(width);
      at += record.at + kRecordHeader;
      set_number(las, at, width, odd_integer(get_number(*las, at, width), width, dice));
    }
  }
}

/// Another number of points, with as many records.
void change_points(std::string* las, Dice& dice) {
  const std::size_t from = get_number(*las, kPointsAt, 4), size = get_number(*las, kPointSizeAt, 2);
  if (from >= las->size() || size == 0 || size > las->size() - from) return;
  const std::size_t there = (las->size() - from) / size;
  const std::size_t record = from + size * dice.below(there);
  std::uint64_t count = there;
  if (dice.one_in(2)) {
    las->insert(record, las->substr(record, size));
    ++count;
    move_offsets(las, record + size, static_cast<std::int64_t>(size));
  } else {
    las->erase(record, size);
    --count;
    move_offsets(las, record + size, -static_cast<std::int64_t>(size));
  }
  set_number(las, kPointsAt, 4, from);
  set_number(las, kLegacyCountAt, 4, count);
  if (get_number(*las, kHeaderSizeAt, 2) >= kHeader14 && las->size() >= kHeader14) {
    set_number(las, kCountAt, 8, count);
  }
}

}  // namespace

std::string mutate_las(std::string_view input, Dice& dice, const ByteMutation& bytes) {
  std::string out(input);
  if (out.size() < kLeastHeader || out.compare(0, 4, "LASF") != 0) {
    return bytes(input, input.size() + 16);
  }
  switch (dice.below(4)) {
    case 0:
      change_field(&out, dice);
      break;
    case 1:
      change_points(&out, dice);
      break;
    default:
      change_record(&out, dice, bytes);
  }
  return out;
}

}  // namespace camber::fuzz
