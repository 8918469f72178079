/// Read the JSON files that `joybridge export` writes. Of escapes it knows \" and \\, which names may contain.
#pragma once

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace joybridge {

/// Throws std::invalid_argument unless a file fits.
inline void require(bool fits, std::string_view otherwise = "the policy is damaged") {
  if (!fits) throw std::invalid_argument(std::string(otherwise));
}

/// A part of a JSON file. What is not there is an empty part.
struct Json {
  std::string text;                // of a string, a number or a word
  double number = 0;               // if it is one
  std::vector<Json> items;         // of a list or an object
  std::vector<std::string> names;  // of the items of an object

  Json() = default;

  /// Returns the content of a file.
  static Json read(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) throw std::invalid_argument("cannot read " + path);
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    std::string_view rest = text;
    return Json(rest);
  }

  /// Reads what a text begins with, and removes it from the text.
  explicit Json(std::string_view& rest, int depth = 0) {
    require(depth <= MAX_DEPTH, "JSON has too many brackets in each other");
    const char first = skip(rest);
    if (first == '[' || first == '{') {
      for (rest.remove_prefix(1); skip(rest) != (first == '[' ? ']' : '}');) {
        if (first == '{') names.push_back(Json(rest, depth + 1).text);
        items.push_back(Json(rest, depth + 1));
      }
      rest.remove_prefix(1);
    } else if (first == '"') {
      std::size_t place = 1;
      for (; rest.at(place) != '"'; ++place) text += rest.at(place += rest[place] == '\\');
      rest.remove_prefix(place + 1);
    } else {
      text = rest.substr(0, rest.find_first_of(" \r\n,]}"));
      if (text.empty()) throw std::invalid_argument("JSON has a bracket in a wrong place");
      std::from_chars(text.data(), text.data() + text.size(), number);
      rest.remove_prefix(text.size());
    }
  }

  /// Returns whether the file has this part.
  bool there() const { return !text.empty() || !items.empty(); }

  /// Returns the number as a place in a list. Throws std::invalid_argument if it is none.
  std::size_t place() const {
    require(number >= 0 && number < MAX_PLACE, "JSON has something else where a place in a list is expected");
    return std::size_t(number);
  }

  /// Returns the part of an object that has a name.
  const Json& operator[](std::string_view name) const {
    static const Json nothing;
    const auto found = std::find(names.begin(), names.end(), name);
    return found == names.end() ? nothing : items[found - names.begin()];
  }

  /// Returns an array: little-endian floats of 32 bits, as base64.
  std::vector<float> floats() const {
    constexpr std::string_view DIGITS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::vector<float> numbers;
    std::uint32_t bits = 0, word = 0;
    int count = 0, bytes = 0;
    for (const char digit : (*this)["float32"].text) {
      if (digit == '=') break;
      bits = bits << 6 | std::uint32_t(DIGITS.find(digit));
      count += 6;
      if (count < 8) continue;
      count -= 8;
      word = word >> 8 | (bits >> count) << 24;
      if (++bytes % 4 == 0) numbers.push_back(std::bit_cast<float>(word));
    }
    return numbers;
  }

 private:
  static constexpr int MAX_DEPTH = 64;
  static constexpr double MAX_PLACE = 1e9;

  /// Removes what separates values, and returns what follows.
  static char skip(std::string_view& rest) {
    rest.remove_prefix(std::min(rest.find_first_not_of(" \r\n,:"), rest.size()));
    return rest.at(0);
  }
};

}  // namespace joybridge
