#include "apps/terminal/help.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <sstream>
#include <string_view>
#include <vector>

#include "apps/options.h"
#include "apps/verbs.h"
#include "src/settings/internal/did_you_mean.h"

namespace palpate::apps {
namespace {

constexpr std::size_t kMaxLines = 45, kPipeWidth = 80, kMinWidth = 40, kMaxWidth = 110;
constexpr std::size_t kOptionColumn = 26, kVerbColumn = 13;  // of the descriptions

constexpr std::array kFirstOptions = {
    "--output", "--camera",   "--depth-sequence", "--depth",  "--intrinsics", "--depth-unit",
    "--scene",  "--cloud",    "--pose",           "--poses",  "--tool-frame", "--path",
    "--device", "--duration", "--method",         "--object", "--backend",    "--view",
    "--json",   "--settings", "--stiffness"};
/// Options that are first ones of a verb alone.
constexpr std::array kFirstOfVerbs = {"pack --unit", "pack --spheres", "query --std",
                                      "query --clearance"};

bool is_first(const CLI::App& verb, const CLI::Option& option) {
  const std::string named = verb.get_name() + " " + option.get_name();
  if (std::ranges::count(kFirstOfVerbs, named) > 0) return true;
  return option.get_positional() || std::ranges::any_of(kFirstOptions, [&](std::string_view name) {
           return option.check_lname(std::string(name.substr(2)));
         });
}

/// Adds text from `column` on, in lines of at most `width` columns; the first line is begun.
void wrap(std::string& page, std::string_view text, std::size_t column, std::size_t width) {
  std::size_t at = column;
  std::istringstream words{std::string(text)};
  bool is_begun = false;
  for (std::string word; words >> word; is_begun = true) {
    if (is_begun && at + 1 + word.size() > width) {
      page += "\n" + std::string(column, ' ');
      at = column;
      is_begun = false;
    }
    at += word.size() + (is_begun ? 1 : 0);
    page += is_begun ? " " : "";
    for (; at > width && word.size() > width - column; at = column + word.size()) {  // too long
      page += word.substr(0, width - column) + "\n" + std::string(column, ' ');
      word.erase(0, width - column);
    }
    page += word;
  }
  page += '\n';
}

/// Adds a row of two columns, the second one from `column` on.
void add_row(std::string& page, const std::string& left, std::string_view right, std::size_t column,
             std::size_t width) {
  std::string row = "  " + left;
  if (row.size() + 2 > column) row += "\n" + std::string(column, ' ');
  const std::size_t begin = row.rfind('\n') == std::string::npos ? 0 : row.rfind('\n') + 1;
  row.resize(std::max(row.size(), begin + column), ' ');
  page += row;
  wrap(page, right, column, width);
}

/// Returns "-o,--output FILE".
std::string signature(const CLI::Option& option, bool is_all) {
  std::string text = option.get_name(option.get_positional(), !option.get_positional());
  if (!option.get_option_text().empty()) return text + " " + option.get_option_text();
  if (option.get_items_expected_max() == 0) return text;
  // A form of many parts is explained, and its parts are in the whole help.
  const std::string& type = option.get_type_name();
  text += " " + (is_all ? type : type.substr(0, type.find("[,")));
  if (!option.get_default_str().empty()) text += "=" + option.get_default_str();
  return text;
}

/// Returns the description; in a short help its first part.
std::string_view description(const CLI::Option& option, bool is_all) {
  const std::string_view text = option.get_description();
  return is_all ? text : text.substr(0, text.find("; "));
}

std::string usage(const CLI::App& app) {
  const CLI::App* const parent = app.get_parent();
  std::string text =
      "Usage: " + (parent != nullptr ? parent->get_name() + " " : "") + app.get_name();
  if (!app.get_subcommands({}).empty()) return text + " VERB [options]\n";
  std::string optional = " [options]";
  for (const CLI::Option* option : app.get_options()) {
    const std::string type = option->get_type_name();
    if (option->get_positional()) {
      text += option->get_required() ? " " + type : " [" + type + "]";
    } else if (option->get_required()) {
      const auto& shorts = option->get_snames();
      text += " " + (shorts.empty() ? option->get_name() : "-" + shorts.front()) + " " + type;
    }
  }
  return text + optional + "\n";
}

/// Returns the verbs in the order of their groups.
void add_verbs(const CLI::App& app, std::string& page, std::size_t width) {
  std::string heading;
  for (const CLI::App* verb : app.get_subcommands({})) {
    if (verb->get_group() != heading) page += "\n" + (heading = verb->get_group()) + ":\n";
    add_row(page, verb->get_name(), verb->get_description(), kVerbColumn, width);
  }
}

std::string text_of(const CLI::App& app, std::size_t width, bool is_all) {
  std::string page, left_out;
  wrap(page, app.get_description(), 0, width);
  page += usage(app);
  add_verbs(app, page, width);
  for (const std::string& group : app.get_groups()) {
    if (group.empty()) continue;  // hidden
    const auto shown = app.get_options([&](const CLI::Option* option) {
      return option->get_group() == group && (is_all || is_first(app, *option));
    });
    const auto all =
        app.get_options([&](const CLI::Option* option) { return option->get_group() == group; });
    if (!all.empty() && shown.empty()) left_out += (left_out.empty() ? "" : ", ") + group;
    if (shown.empty()) continue;
    page += "\n" + group + ":\n";
    for (const CLI::Option* option : shown) {
      add_row(page, signature(*option, is_all), description(*option, is_all), kOptionColumn, width);
    }
  }
  if (!left_out.empty()) {
    page += "\n";
    wrap(page, "More, by --help-all: " + left_out + ".", 0, width);
  }
  page += "\n";
  std::istringstream footer(app.get_footer());
  for (std::string line; std::getline(footer, line);) {
    const std::size_t indent = line.starts_with("Example: ") ? 9 : 0;
    page += line.substr(0, indent);
    wrap(page, line.substr(indent), indent, width);
  }
  return page;
}

/// Returns the columns of the terminal that stdout is; 80 in a pipe.
std::size_t columns() {
  winsize size{};
  if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return kPipeWidth;
  return std::clamp<std::size_t>(size.ws_col, kMinWidth, kMaxWidth);
}

}  // namespace

std::string help_text(const CLI::App& app, std::size_t width, bool is_all) {
  std::string whole = text_of(app, width, true);
  const auto num_lines = static_cast<std::size_t>(std::ranges::count(whole, '\n'));
  return is_all || num_lines <= kMaxLines ? whole : text_of(app, width, false);
}

void use_help_text(CLI::App& app) {
  app.set_help_flag("-h,--help", "Print the most important options and exit");
  app.set_help_all_flag("--help-all", "Print all options and exit");
  app.formatter_fn([](const CLI::App* shown, const std::string&, CLI::AppFormatMode mode) {
    return help_text(*shown, columns(), mode == CLI::AppFormatMode::All);
  });
}

void add_help(CLI::App& program, Action&) {
  CLI::App& app = *program.add_subcommand("help", "Explain a verb: palpate help touch.");
  const auto verb = std::make_shared<std::string>();
  app.add_option("verb", *verb, "the verb to explain; none: list them")->type_name("VERB");
  app.footer("Example: palpate help touch");
  app.callback([verb, &program] {
    const CLI::App* shown = verb->empty() ? &program : nullptr;
    std::vector<std::string> verbs;
    for (const CLI::App* known : program.get_subcommands({})) {
      if (known->check_name(*verb)) shown = known;
      verbs.push_back(known->get_name());
    }
    if (shown == nullptr) {
      usage_error("help: there is no verb '" + *verb + "'" + did_you_mean(*verb, verbs));
    }
    std::string text = help_text(*shown, columns(), false);
    text.pop_back();  // a line feed, which the parser adds
    throw CLI::CallForVersion(text, 0);
  });
}

}  // namespace palpate::apps
