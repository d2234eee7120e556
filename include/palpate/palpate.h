// The main header: pack or load a tool, turn images into surfaces with a Sensor, and measure the
// contact with a Contact. Needs only the standard library.
//
//   auto tool = palpate::load_tool("stylus.palp").value();
//   auto sensor = palpate::Sensor::create({640, 480, {525, 525, 319.5, 239.5}}).value();
//   auto contact = palpate::Contact::create(tool).value();
//   auto result = contact.measure(sensor.update({640, 480, counts, 0.001}), X_WT);
//   palpate::Wrench F_W = palpate::VolumeStiffness{1e6} * result.penetration.measure_W;
//
// Pass palpate::Place::cuda() to both to compute on a GPU.
#pragma once

#include "palpate/contact/contact.h"
#include "palpate/field/sensor.h"
#include "palpate/io/files.h"
#include "palpate/packing/packing.h"
#include "palpate/tool/tool.h"
#include "palpate/version.h"
