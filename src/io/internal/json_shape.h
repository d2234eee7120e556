// Looks at a JSON text before it is believed.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

namespace palpate { inline namespace v0 {

/// A document of bounded depth, with so many members in an object at most, in which no key is given
/// twice, as of two one reader takes the first and another the last. In a pass of its own:
/// nlohmann's parser with a callback takes quadratic time for long lists, and so do its ordered
/// objects for many members.
class JsonShape final : public nlohmann::json_sax<nlohmann::json> {
 public:
  /// Returns the fault: the rest of a sentence that begins with the name of the text; empty if
  /// there is none.
  static std::string fault_of(std::string_view text, std::size_t max_depth,
                              std::size_t max_members = SIZE_MAX) {
    JsonShape shape(max_depth, max_members);
    nlohmann::json::sax_parse(text.begin(), text.end(), &shape);
    return shape.fault_;
  }

  bool null() override { return true; }
  bool boolean(bool) override { return true; }
  bool number_integer(std::int64_t) override { return true; }
  bool number_unsigned(std::uint64_t) override { return true; }
  bool number_float(double, const std::string&) override { return true; }
  bool string(std::string&) override { return true; }
  bool binary(nlohmann::json::binary_t&) override { return true; }
  bool start_object(std::size_t) override { return enter(); }
  bool start_array(std::size_t) override { return enter(); }
  bool key(std::string& name) override {
    keys_.back().push_back(name);
    if (keys_.back().size() > max_members_) {
      fault_ = "gives more than " + std::to_string(max_members_) + " members to an object";
    }
    return fault_.empty();
  }
  bool end_object() override {
    std::sort(keys_.back().begin(), keys_.back().end());
    const auto twin = std::adjacent_find(keys_.back().begin(), keys_.back().end());
    if (twin != keys_.back().end()) fault_ = "gives '" + *twin + "' twice";
    keys_.pop_back();
    return fault_.empty();
  }
  bool end_array() override {
    keys_.pop_back();
    return true;
  }
  bool parse_error(std::size_t, const std::string&, const nlohmann::json::exception&) override {
    fault_ = "is not JSON or is truncated";
    return false;
  }

 private:
  JsonShape(std::size_t max_depth, std::size_t max_members)
      : max_depth_(max_depth), max_members_(max_members) {}

  bool enter() {
    keys_.emplace_back();
    if (keys_.size() > max_depth_) {
      fault_ = "nests more than " + std::to_string(max_depth_) + " levels of JSON";
    }
    return fault_.empty();
  }

  const std::size_t max_depth_, max_members_;
  std::string fault_;
  std::vector<std::vector<std::string>> keys_;  // of the objects and lists that are open
};

}}  // namespace palpate::v0
