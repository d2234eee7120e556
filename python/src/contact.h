// palpate.Contact, for its files of bindings.
#pragma once

#include <memory>
#include <mutex>
#include <string>

#include "palpate/contact/contact.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"

namespace palpate::python {

class PyContact {
 public:
  PyContact(const PyTool& tool, const ContactMethod& method, const Place& place, int threads)
      : tool_(tool), place_(place), contact_(make(*tool.tool, method, place, threads)) {}

  const PyTool& tool() const { return tool_; }
  const Place& place() const { return place_; }
  std::string method() const {
    return std::string(name_of(contact_options(contact_.query().method()).method));
  }
  /// One thread at a time; without the GIL.
  template <class Work>
  auto alone(const Work& work) {
    const nb::gil_scoped_release no_gil;
    const std::lock_guard lock(mutex_);
    return work(contact_);
  }

 private:
  static Contact make(const Tool& tool, const ContactMethod& method, const Place& place,
                      int threads) {
    Result<Contact> contact = Error{};
    {
      const nb::gil_scoped_release no_gil;
      contact = Contact::create(tool, method, place, threads);
    }
    return taken(std::move(contact));
  }

  PyTool tool_;  // outlives the contact
  Place place_;
  Contact contact_;
  std::mutex mutex_;
};

/// In bind_batch.cpp: P poses at once.
nb::object measure_batch(PyContact& self, nb::handle surfaces, nb::handle poses,
                         nb::handle surface_of_pose, bool stiffness, nb::handle out,
                         nb::handle stream);

}  // namespace palpate::python
