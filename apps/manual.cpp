#include "apps/program.h"

#include <string>
#include <string_view>
#include <vector>

#include "src/io/internal/atomic_file.h"

namespace palpate::apps {
namespace {

/// Escapes text for roff.
std::string plain(std::string_view text) {
  std::string roff;
  bool begins_line = true;
  for (const char c : text) {
    if (begins_line && (c == '.' || c == '\'')) roff += "\\&";
    if (c == '\\') {
      roff += "\\e";
    } else if (c == '-') {
      roff += "\\-";
    } else {
      roff += c;
    }
    begins_line = c == '\n';
  }
  return roff;
}

/// Returns "-o,--output FILE" as in --help.
std::string signature(const CLI::Option& option) {
  const bool is_flag = option.get_items_expected_max() == 0;
  std::string text = "\\fB" + plain(option.get_name(option.get_positional())) + "\\fR";
  if (is_flag) return text;
  text += " \\fI" + plain(option.get_type_name()) + "\\fR";
  if (!option.get_default_str().empty()) text += "=" + plain(option.get_default_str());
  return text;
}

void add_options(const CLI::App& app, std::string& page) {
  for (const std::string& group : app.get_groups()) {
    if (group.empty()) continue;  // hidden
    const auto options =
        app.get_options([&](const CLI::Option* option) { return option->get_group() == group; });
    if (options.empty()) continue;
    page += ".SH " + (group == "Options" ? "OPTIONS" : plain(group)) + "\n";
    for (const CLI::Option* option : options) {
      page += ".TP\n" + signature(*option) + "\n" + plain(option->get_description()) + "\n";
    }
  }
}

std::string page_of(const CLI::App& program, const CLI::App* verb) {
  const std::string name = program.get_name() + (verb ? "-" + verb->get_name() : "");
  const std::string description = (verb ? *verb : program).get_description();
  std::string page = ".TH " + plain(name) + " 1 \"\" \"" + plain(program.version()) +
                     "\" \"User Commands\"\n.SH NAME\n" + plain(name) + " \\- " +
                     plain(description) + "\n.SH SYNOPSIS\n.B palpate";
  if (!verb) {
    page += "\n.I VERB\n[options]\n.SH VERBS\n";
    for (const CLI::App* known : program.get_subcommands({})) {
      page += ".TP\n\\fBpalpate\\-" + plain(known->get_name()) + "\\fR(1)\n" +
              plain(known->get_description()) + "\n";
    }
    add_options(program, page);
    return page + ".SH NOTES\n" + plain(program.get_footer()) + "\n";
  }
  page += " " + plain(verb->get_name()) + "\n";
  for (const CLI::Option* option : verb->get_options()) {
    if (option->get_positional()) page += ".I " + plain(option->get_name(true)) + "\n";
  }
  page += "[options]\n";
  add_options(*verb, page);
  if (!verb->get_footer().empty()) page += ".SH NOTES\n" + plain(verb->get_footer()) + "\n";
  return page + ".SH SEE ALSO\n.BR palpate (1)\n";
}

/// Returns the words that an option takes: the list at the end of its description.
std::string words_of(const CLI::Option& option) {
  if (!std::string_view(option.get_type_name()).starts_with("NAME")) return {};
  const std::string& text = option.get_description();
  const std::size_t colon = text.rfind(": ");
  if (colon == std::string::npos) return {};
  std::string words;
  for (const char c : text.substr(colon + 2)) {
    if (c != ',') words += c;
  }
  return words;
}

std::string bash_completion(const CLI::App& program) {
  std::string verbs = "--help --version --licenses --quiet", cases, values;
  for (const CLI::App* verb : program.get_subcommands({})) {
    verbs += " " + verb->get_name();
    std::string flags;
    for (const CLI::Option* option : verb->get_options()) {
      for (const std::string& flag : option->get_lnames()) {
        flags += (flags.empty() ? "--" : " --") + flag;
        const std::string words = words_of(*option);
        if (words.empty()) continue;
        values += "    " + verb->get_name() + ":--" + flag + ") words=\"" + words + "\" ;;\n";
      }
    }
    cases += "      " + verb->get_name() + ") words=\"" + flags + "\" ;;\n";
  }
  return "# Completion of palpate for bash. Made by the program itself.\n"
         "_palpate() {\n"
         "  local word=${COMP_WORDS[COMP_CWORD]} verb=${COMP_WORDS[1]} words=\n"
         "  case \"$verb:${COMP_WORDS[COMP_CWORD-1]}\" in\n" +
         values +
         "  esac\n"
         "  if [ \"$COMP_CWORD\" -eq 1 ]; then\n"
         "    words=\"" +
         verbs +
         "\"\n"
         "  elif [[ $word == -* ]]; then\n"
         "    case \"$verb\" in\n" +
         cases +
         "    esac\n"
         "  fi\n"
         "  COMPREPLY=($(compgen -W \"$words\" -- \"$word\"))\n"
         "}\n"
         "complete -o default -F _palpate palpate\n";
}

}  // namespace

Status write_manual(const CLI::App& program, const std::filesystem::path& folder) {
  std::vector<std::pair<std::string, std::string>> files{
      {"palpate.1", page_of(program, nullptr)}, {"palpate.bash", bash_completion(program)}};
  for (const CLI::App* verb : program.get_subcommands({})) {
    files.emplace_back("palpate-" + verb->get_name() + ".1", page_of(program, verb));
  }
  for (const auto& [name, content] : files) {
    if (const Status status = write_file_atomically(folder / name, content); !status) return status;
  }
  return Done{};
}

}  // namespace palpate::apps
