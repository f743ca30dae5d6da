#include <algorithm>
#include <vector>

#include "fuzz/mutators/mutator.h"

namespace camber::fuzz {
namespace {

// Format 2.0 of ROS 1's bags: records of fields "name=value" and data, each with its length before.
constexpr std::string_view kMagic = "#ROSBAG V2.0\n";
constexpr int kBagHeader = 3, kChunk = 5, kChunkInfo = 6, kConnection = 7;

struct Record {
  std::vector<std::string> fields;
  std::string data;

  std::string* find(std::string_view name) {
    for (std::string& field : fields) {
      if (field.size() > name.size() && field.compare(0, name.size(), name) == 0 &&
          field[name.size()] == '=') {
        return &field;
      }
    }
    return nullptr;
  }
  int op() {
    const std::string* const field = find("op");
    return field != nullptr && field->size() == 4 ? field->back() : 0;
  }
  void set(std::string_view name, int width, std::uint64_t value) {
    std::string* const field = find(name);
    if (field == nullptr || field->size() != name.size() + 1 + static_cast<std::size_t>(width)) {
      return;
    }
    set_number(field, name.size() + 1, width, value);
  }
};

std::string counted(const std::string& bytes) {
  std::string out(4, '\0');
  set_number(&out, 0, 4, bytes.size());
  return out + bytes;
}

std::string bytes_of(const Record& record) {
  std::string header;
  for (const std::string& field : record.fields) header += counted(field);
  return counted(header) + counted(record.data);
}

std::string bytes_of(const std::vector<Record>& records) {
  std::string out;
  for (const Record& record : records) out += bytes_of(record);
  return out;
}

/// Bytes with their length before them, taken off the front; whether they were whole.
bool take(std::string_view* from, std::string_view* out) {
  if (from->size() < 4) return false;
  const std::uint64_t size = get_number(*from, 0, 4);
  if (size > from->size() - 4) return false;
  *out = from->substr(4, static_cast<std::size_t>(size));
  from->remove_prefix(4 + out->size());
  return true;
}

std::vector<Record> records_of(std::string_view bytes) {
  std::vector<Record> out;
  std::string_view header, data, field;
  while (take(&bytes, &header) && take(&bytes, &data)) {
    Record record;
    while (take(&header, &field)) record.fields.emplace_back(field);
    record.data = std::string(data);
    out.push_back(std::move(record));
  }
  return out;
}

void change_field(Record* record, Dice& dice, const ByteMutation& bytes) {
  if (record->fields.empty()) return;
  std::string& field = dice.of(record->fields);
  const std::size_t equals = field.find('=');
  if (equals == std::string::npos) return;
  const std::size_t from = equals + 1, size = field.size() - from;
  switch (dice.below(5)) {
    case 0:
      field = field.substr(0, from) + bytes(field.substr(from), size + 8);
      break;
    case 1:
      record->fields.erase(std::find(record->fields.begin(), record->fields.end(), field));
      break;
    case 2:
      record->fields.push_back(std::string(field));
      break;
    default: {
      int width = 8;
      while (static_cast<std::size_t>(width) > size && width > 1) width /= 2;
      if (size == 0) return;
      set_number(&field, from, width, odd_integer(get_number(field, from, width), width, dice));
    }
  }
}

void change(std::vector<Record>* records, Dice& dice, const ByteMutation& bytes) {
  if (records->empty()) return;
  const std::size_t at = dice.below(records->size());
  Record& record = (*records)[at];
  switch (dice.below(8)) {
    case 0:
      records->erase(records->begin() + static_cast<long>(at));
      break;
    case 1:
      records->insert(records->begin() + static_cast<long>(at), Record(record));
      break;
    case 2:
      std::swap(record, dice.of(*records));
      break;
    case 3:
    case 4:
      change_field(&record, dice, bytes);
      break;
    default:
      if (record.op() == kChunk && record.data.size() < (1 << 20) &&
          record.find("compression") != nullptr &&
          *record.find("compression") == "compression=none") {
        std::vector<Record> inner = records_of(record.data);
        change(&inner, dice, bytes);
        record.data = bytes_of(inner);
        record.set("size", 4, record.data.size());
      } else if (record.op() == kConnection) {  // its data are fields of their own
        Record fields = records_of(counted(record.data) + counted("")).front();
        change_field(&fields, dice, bytes);
        record.data.clear();
        for (const std::string& field : fields.fields) record.data += counted(field);
      } else {
        record.data = bytes(record.data, record.data.size() + 16);
      }
  }
}

/// Offsets and counts as the records lie now.
void mend(std::vector<Record>* records) {
  std::uint64_t at = kMagic.size(), index_at = 0, connections = 0;
  std::vector<std::uint64_t> chunks;
  for (Record& record : *records) {
    if (record.op() == kChunk) chunks.push_back(at);
    if (record.op() == kConnection && index_at == 0) index_at = at;
    if (record.op() == kConnection) ++connections;
    at += bytes_of(record).size();
  }
  std::size_t chunk = 0;
  for (Record& record : *records) {
    if (record.op() == kBagHeader) {
      record.set("index_pos", 8, index_at);
      record.set("conn_count", 4, connections);
      record.set("chunk_count", 4, chunks.size());
    } else if (record.op() == kChunkInfo && chunk < chunks.size()) {
      record.set("chunk_pos", 8, chunks[chunk++]);
    }
  }
}

}  // namespace

std::string mutate_bag(std::string_view input, Dice& dice, const ByteMutation& bytes) {
  if (input.substr(0, kMagic.size()) != kMagic) return bytes(input, input.size() + 16);
  std::vector<Record> records = records_of(input.substr(kMagic.size()));
  if (records.empty()) return bytes(input, input.size() + 16);
  const bool sound = !dice.one_in(5);
  change(&records, dice, bytes);
  if (sound) mend(&records);
  return std::string(kMagic) + bytes_of(records);
}

}  // namespace camber::fuzz
