/// The command line: serve until SIGINT or SIGTERM, or let a policy play.

#include <charconv>
#include <iostream>
#include <stdexcept>

#include "paddle.hpp"
#include "refusal.hpp"
#include "scores.hpp"
#include "server.hpp"

namespace {

constexpr char USAGE[] =
    "usage: paddle [--address HOST:PORT] [--sessions MOST] [--tls-cert FILE --tls-key FILE] [--token-file FILE]\n"
    "       paddle --policy FILE [--episodes COUNT] [--seed SEED]\n"
    "  --address     where to listen, port 0 being any free one; default 127.0.0.1:5005. An address that other\n"
    "                machines can reach needs --tls-cert, --tls-key and --token-file\n"
    "  --sessions    the most sessions at once; default 64\n"
    "  --tls-cert    encrypt with this certificate (PEM, with chain)\n"
    "  --tls-key     the private key of the certificate (PEM)\n"
    "  --token-file  accept only clients that send the token in this file\n"
    "  --policy      let a policy play that `joybridge export RUN policy.json` wrote, and serve nothing\n"
    "  --episodes    how many it plays; default 20\n"
    "  --seed        of what it plays; default 0\n";

/// Returns a number of the command line. Throws std::invalid_argument if it is not a number in low .. high.
int number(const std::string& what, const std::string& text, int low, int high) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error == std::errc() && end == text.data() + text.size() && value >= low && value <= high) return value;
  throw std::invalid_argument(simulator::text(what, " is '", text, "', expected a number in ", low, "..", high));
}

}  // namespace

int main(int count, char** words) {
  std::string address = "127.0.0.1:5005";
  std::string policy;
  int sessions = 64, episodes = 20, seed = 0;
  simulator::Files files;
  try {
    for (int place = 1; place < count; place += 2) {
      const std::string name = words[place], value = place + 1 < count ? words[place + 1] : "";
      if (value.empty() && name != "--help") {
        throw std::invalid_argument("'" + name + "' needs a value; see --help");
      } else if (name == "--address") {
        number("the port of --address", value.substr(value.rfind(':') + 1), 0, 65535);
        address = value;
      } else if (name == "--sessions") {
        sessions = number(name, value, 1, 1'000'000);
      } else if (name == "--tls-cert") {
        files.certificate = value;
      } else if (name == "--tls-key") {
        files.key = value;
      } else if (name == "--token-file") {
        files.token = value;
      } else if (name == "--policy") {
        policy = value;
      } else if (name == "--episodes") {
        episodes = number(name, value, 1, 1'000'000);
      } else if (name == "--seed") {
        seed = number(name, value, 0, 1'000'000'000);
      } else if (name == "--help") {
        std::cout << USAGE;
        return 0;
      } else {
        throw std::invalid_argument("unknown argument '" + name + "'; see --help");
      }
    }
    simulator::Games games;
    auto paddle = std::make_unique<simulator::Paddle>();
    const std::string name = paddle->describe({}).name();
    games[name] = std::move(paddle);  // add your own game here
    if (policy.empty()) {
      simulator::serve(games, address, static_cast<std::size_t>(sessions), files);
    } else {
      std::cout << simulator::scores(games, policy, episodes, static_cast<std::uint64_t>(seed)) << std::endl;
    }
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << std::endl;
    return 2;
  }
  return 0;
}
