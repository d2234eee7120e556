// The main header: pack or load a tool, turn images into surfaces with a Sensor, and measure the
// contact with a Contact. Needs only the standard library.
//
//   auto mesh = palpate::make_stylus(0.005, 0.15, 0.02, 48);  // or load_mesh and check_solid
//   auto tool = palpate::Tool::pack(mesh, {.max_spheres = 5000}).value();
//   auto sensor = palpate::Sensor::create({640, 480, {525, 525, 319.5, 239.5}}).value();
//   auto contact = palpate::Contact::create(tool).value();
//   auto result = contact.measure(sensor.update({640, 480, counts, 0.001}), X_WT);
//   palpate::Wrench F_W = palpate::VolumeStiffness{1e6} * result.penetration.measure_W;
//
// Store the tool with save_tool and read it with load_tool. Pass palpate::Place::cuda() to both,
// Sensor and Contact, to compute on a GPU. For a live loop see palpate/run/run_loop.h.
#pragma once

#include "palpate/contact/contact.h"
#include "palpate/contact/scene.h"
#include "palpate/field/sensor.h"
#include "palpate/io/files.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "palpate/tool/tool.h"
#include "palpate/version.h"
