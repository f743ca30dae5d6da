#include <nlohmann/json.hpp>

#include "fuzz/mutators/mutator.h"

namespace camber::fuzz {
namespace {

using Json = nlohmann::ordered_json;

/// Every value of a document, the whole first; keys of all its objects.
struct Nodes {
  std::vector<Json*> all;
  std::vector<std::string> keys;
};

Nodes nodes_of(Json& document) {
  Nodes out;
  out.all.push_back(&document);
  for (std::size_t i = 0; i < out.all.size(); ++i) {
    Json* const node = out.all[i];
    if (node->is_object()) {
      for (auto it = node->begin(); it != node->end(); ++it) {
        out.keys.push_back(it.key());
        out.all.push_back(&it.value());
      }
    } else if (node->is_array()) {
      for (Json& element : *node) out.all.push_back(&element);
    }
  }
  return out;
}

Json odd_value(const Json& old, Dice& dice) {
  switch (dice.below(12)) {
    case 0:
      return nullptr;
    case 1:
      return dice.one_in(2);
    case 2:
      return Json::array();
    case 3:
      return Json::object();
    case 4:
      return "";
    case 5:
      return Json::array({old});
    case 6:
      return Json::object({{"id", old}});
    case 7:
      return Json::array({old, old});
    case 8:
      return old.is_number() ? Json(-old.get<double>()) : Json(-1);
    case 9:
      return odd_double(old.is_number() ? old.get<double>() : 1.0, dice);
    case 10:
      return static_cast<std::int64_t>(odd_integer(1, 8, dice));
    default:
      return dice.below(40);
  }
}

void change_array(Json* array, Dice& dice) {
  const std::size_t n = array->size();
  switch (n == 0 ? 5 : dice.below(6)) {
    case 0:
      array->erase(dice.below(n));
      break;
    case 1:
      array->push_back((*array)[dice.below(n)]);
      break;
    case 2:
      std::swap((*array)[dice.below(n)], (*array)[dice.below(n)]);
      break;
    case 3:
      array->get_ref<Json::array_t&>().resize(dice.below(n));
      break;
    case 4:
      for (std::size_t more = std::min<std::size_t>(n, 64); more > 0; --more) {
        array->push_back((*array)[array->size() - n]);
      }
      break;
    default:
      array->push_back(odd_value(n > 0 ? array->front() : Json(1), dice));
  }
}

void change_object(Json* object, const Nodes& nodes, Dice& dice) {
  const std::size_t n = object->size();
  const auto key = [&] {
    return std::next(object->begin(), static_cast<long>(dice.below(n))).key();
  };
  if (n == 0 || dice.one_in(3)) {
    Json copy = *nodes.all[dice.below(nodes.all.size())];
    const std::string name = nodes.keys.empty() ? "id" : nodes.keys[dice.below(nodes.keys.size())];
    (*object)[name] = std::move(copy);
  } else if (dice.one_in(2)) {
    object->erase(key());
  } else {
    const std::string from = key();
    Json value = (*object)[from];
    object->erase(from);
    (*object)[dice.one_in(4) ? from + "_" : nodes.keys[dice.below(nodes.keys.size())]] =
        std::move(value);
  }
}

/// A number that nlohmann's own numbers cannot hold, in place of one of the text's.
void put_odd_number(std::string* text, Dice& dice) {
  const std::size_t start = dice.below(text->size());
  const std::size_t from = text->find_first_of("0123456789", start);
  if (from == std::string::npos) return;
  const std::size_t to = text->find_first_not_of("0123456789.eE+-", from);
  text->replace(from, std::min(to, text->size()) - from, odd_number_text(dice));
}

}  // namespace

std::string mutate_json(std::string_view input, Dice& dice, const ByteMutation& bytes) {
  constexpr std::size_t kMostNodes = 20000;
  Json document = Json::parse(input, nullptr, false);
  if (document.is_discarded()) return bytes(input, input.size() + 16);
  const Nodes nodes = nodes_of(document);
  if (nodes.all.size() > kMostNodes) return bytes(input, input.size() + 16);
  Json* const node = nodes.all[dice.below(nodes.all.size())];
  const std::size_t what = dice.below(8);
  if (what == 0) {
    Json copy = *nodes.all[dice.below(nodes.all.size())];
    *node = std::move(copy);
  } else if (node->is_array() && what < 6) {
    change_array(node, dice);
  } else if (node->is_object() && what < 6) {
    change_object(node, nodes, dice);
  } else if (node->is_string() && what < 6) {
    const std::string& text = node->get_ref<const std::string&>();
    *node = bytes(text, text.size() + 8);
  } else {
    *node = odd_value(*node, dice);
  }
  std::string out =
      document.dump(dice.one_in(6) ? 1 : -1, ' ', false, Json::error_handler_t::replace);
  if (dice.one_in(6)) put_odd_number(&out, dice);
  return out;
}

}  // namespace camber::fuzz
