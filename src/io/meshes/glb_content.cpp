#include "src/io/meshes/glb_content.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include <assimp/material.h>
#include <assimp/scene.h>
#include <assimp/Exporter.hpp>

namespace palpate { inline namespace v0 {
namespace {

/// glTF wants its colors linear.
float linear_of(std::uint8_t srgb) {
  const double value = srgb / 255.0;
  return static_cast<float>(value <= 0.04045 ? value / 12.92
                                             : std::pow((value + 0.055) / 1.055, 2.4));
}

// Scenes of Assimp own what they point at, and delete it.

std::unique_ptr<aiMaterial> material_of(const ColoredMesh& part) {
  auto material = std::make_unique<aiMaterial>();
  const aiString name(part.name);
  const aiColor4D color(linear_of(part.rgb[0]), linear_of(part.rgb[1]), linear_of(part.rgb[2]), 1);
  const float metallic = 0, roughness = 0.8f;
  material->AddProperty(&name, AI_MATKEY_NAME);
  material->AddProperty(&color, 1, AI_MATKEY_BASE_COLOR);
  material->AddProperty(&metallic, 1, AI_MATKEY_METALLIC_FACTOR);
  material->AddProperty(&roughness, 1, AI_MATKEY_ROUGHNESS_FACTOR);
  return material;
}

std::unique_ptr<aiMesh> mesh_of(const ColoredMesh& part, unsigned material) {
  const TriangleMesh& mesh = part.mesh;
  auto result = std::make_unique<aiMesh>();
  result->mName = part.name;
  result->mMaterialIndex = material;
  result->mPrimitiveTypes = aiPrimitiveType_TRIANGLE;
  result->mNumVertices = static_cast<unsigned>(mesh.vertices.size());
  result->mVertices = new aiVector3D[mesh.vertices.size()];
  std::transform(mesh.vertices.begin(), mesh.vertices.end(), result->mVertices, [](const Vec3d& p) {
    const Vec3f rounded = to_float(p);
    return aiVector3D(rounded.x, rounded.y, rounded.z);
  });
  result->mNumFaces = static_cast<unsigned>(mesh.triangles.size());
  result->mFaces = new aiFace[mesh.triangles.size()];
  for (std::size_t f = 0; f < mesh.triangles.size(); ++f) {
    aiFace& face = result->mFaces[f];
    face.mIndices = new unsigned[3];
    face.mNumIndices = 3;
    std::copy(mesh.triangles[f].begin(), mesh.triangles[f].end(), face.mIndices);
  }
  return result;
}

}  // namespace

Result<std::string> glb_content(std::span<const ColoredMesh* const> parts) try {
  const auto num = static_cast<unsigned>(parts.size());
  aiScene scene;
  scene.mRootNode = new aiNode("palpate");
  scene.mRootNode->mChildren = new aiNode* [num] {};
  scene.mRootNode->mNumChildren = num;
  scene.mMaterials = new aiMaterial* [num] {};
  scene.mNumMaterials = num;
  scene.mMeshes = new aiMesh* [num] {};
  scene.mNumMeshes = num;
  for (unsigned i = 0; i < num; ++i) {
    scene.mMaterials[i] = material_of(*parts[i]).release();
    scene.mMeshes[i] = mesh_of(*parts[i], i).release();
    aiNode* node = scene.mRootNode->mChildren[i] = new aiNode(parts[i]->name);
    node->mParent = scene.mRootNode;
    node->mMeshes = new unsigned[1]{i};
    node->mNumMeshes = 1;
  }
  Assimp::Exporter exporter;
  const aiExportDataBlob* blob = exporter.ExportToBlob(&scene, "glb2");
  if (blob == nullptr || blob->size == 0) {
    return Error{Errc::io_failure, "Assimp cannot make a GLB file of it (" +
                                       std::string(exporter.GetErrorString()) +
                                       "); write a .ply file"};
  }
  return std::string(static_cast<const char*>(blob->data), blob->size);
} catch (const std::exception& error) {
  return Error{Errc::io_failure, "Assimp cannot make a GLB file of it (" +
                                     std::string(error.what()) + "); write a .ply file"};
}

}}  // namespace palpate::v0
