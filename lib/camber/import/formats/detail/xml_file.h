#pragma once

#include <filesystem>
#include <memory>
#include <pugixml.hpp>
#include <string>

namespace camber {

/// An XML file with the lines of its elements. No entities of its own are expanded.
class XmlFile {
 public:
  /// @throws InputError if the file cannot be read or is no well-formed XML.
  static XmlFile read(const std::filesystem::path& path);
  static XmlFile parse(std::string text, const std::string& file);

  pugi::xml_node root() const { return document_->document_element(); }
  const std::string& file() const { return file_; }

  /// @throws InputError "file: line L: reason".
  [[noreturn]] void fail(const pugi::xml_node& at, const std::string& reason) const;

  /// The number in a child element or an attribute, finite. @throws InputError.
  double child_number(const pugi::xml_node& parent, const char* name) const;
  double attribute_number(const pugi::xml_node& element, const char* name) const;

 private:
  double number(const pugi::xml_node& at, const char* text, const char* name) const;
  std::string file_, text_;
  std::unique_ptr<pugi::xml_document> document_ = std::make_unique<pugi::xml_document>();
};

}  // namespace camber
