"""The checker of types itself: what it must find and what it must pass by."""

import unittest

from check_types import types_of


def found(*lines):
    return [name for _, name in types_of("\n".join(lines))]


class CheckTypesTest(unittest.TestCase):
    def test_types_have_the_names_of_their_namespaces(self):
        text = ("namespace a { inline namespace v0 {", "struct One {", "  struct Inner {};", "};",
                "namespace b {", "class Two final : public One {", "};", "}  // namespace b",
                "enum class Three { x };", "}}  // namespace a::v0", "union Four {")
        self.assertEqual(found(*text), ["a::v0::One", "a::v0::b::Two", "a::v0::Three", "Four"])

    def test_those_of_one_file_are_its_own(self):
        self.assertEqual(found("namespace a {", "namespace {", "struct One {", "}  // namespace",
                               "struct Two {", "}  // namespace a"), ["a::Two"])
        self.assertEqual(found("namespace a { inline namespace v0 { namespace {", "struct One {", "};",
                               "}}}  // namespace a::v0", "struct Two {"), ["Two"])

    def test_how_types_are_written(self):
        for line, name in (("struct alignas(8) Plane {", "Plane"), ("class [[nodiscard]] Result {", "Result"),
                           ("template <class T> struct Of {", "Of"), ("struct hash<Key> {", "hash<Key>"),
                           ("struct Impl::Part {", "Impl::Part"), ("enum Kind : int { a, b };", "Kind"),
                           ("struct Done {};", "Done"), ("struct Long", "Long")):
            self.assertEqual(found(line), [name], line)

    def test_what_defines_no_type(self):
        for line in ("struct One;", "struct One one = {};", "  struct One {", "enum class Kind;",
                     "struct One* make(int n) {"):
            self.assertEqual(found(line), [], line)


if __name__ == "__main__":
    unittest.main()
