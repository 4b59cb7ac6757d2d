//! Materials: UsdPreviewSurface with textures, and friction.

use std::sync::Arc;

use genmanip_core::Material;
use genmanip_render::color::linear_from_srgb;
use genmanip_render::encode::{EncodeError, png_rgb};

use super::text::Writer;

impl Writer<'_> {
    /// Name of the prim of a material, which [`Writer::materials`] writes at the end; equal materials share one prim.
    ///
    /// # Errors
    /// When the number of pixels of its texture does not match the size.
    pub(super) fn material(&mut self, material: &Material) -> Result<String, EncodeError> {
        if let Some(texture) = &material.texture
            && !self.textures.iter().any(|known| Arc::ptr_eq(known, texture))
        {
            let name = format!("{}.png", self.textures.len());
            self.files.push((name, png_rgb(texture.width, texture.height, &texture.rgb)?));
            self.textures.push(Arc::clone(texture));
        }
        let place = self.surfaces.iter().position(|known| known == material).unwrap_or_else(|| {
            self.surfaces.push(material.clone());
            self.surfaces.len() - 1
        });
        Ok(format!("surface_{place}"))
    }

    pub(super) fn materials(&mut self) -> Result<(), EncodeError> {
        self.open("Scope", "materials", &[], &[]);
        for (index, material) in std::mem::take(&mut self.surfaces).iter().enumerate() {
            let name = self.open("Material", &format!("surface_{index}"), &[], &[]);
            let path = format!("/World/materials/{name}");
            self.line(&format!("token outputs:surface.connect = <{path}/shader.outputs:surface>"));
            self.shaders(&path, material);
            self.close();
        }
        for friction in std::mem::take(&mut self.frictions) {
            self.open("Material", &friction_name(&friction), &[], &["PhysicsMaterialAPI"]);
            self.line(&format!("float physics:dynamicFriction = {friction}"));
            self.line(&format!("float physics:staticFriction = {friction}"));
            self.close();
        }
        self.close();
        Ok(())
    }

    fn shaders(&mut self, path: &str, material: &Material) {
        let color = linear_from_srgb(material.base_color);
        let texture = material.texture.as_ref();
        let texture = texture.and_then(|own| self.textures.iter().position(|known| Arc::ptr_eq(known, own)));
        self.open("Shader", "shader", &[], &[]);
        self.line("uniform token info:id = \"UsdPreviewSurface\"");
        match texture {
            Some(_) => self.line(&format!("color3f inputs:diffuseColor.connect = <{path}/texture.outputs:rgb>")),
            None => self.line(&format!("color3f inputs:diffuseColor = ({}, {}, {})", color.x, color.y, color.z)),
        }
        for (name, value) in [
            ("ior", material.ior),
            ("metallic", material.metallic),
            ("opacity", material.opacity),
            ("roughness", material.roughness),
        ] {
            self.line(&format!("float inputs:{name} = {value}"));
        }
        self.line("token outputs:surface");
        self.close();
        let Some(texture) = texture else { return };
        self.open("Shader", "texture", &[], &[]);
        self.line("uniform token info:id = \"UsdUVTexture\"");
        let mark = if self.folder.contains('@') { "@@@" } else { "@" };
        self.line(&format!("asset inputs:file = {mark}./{}/{texture}.png{mark}", self.folder));
        self.line(&format!("float4 inputs:scale = ({}, {}, {}, 1)", color.x, color.y, color.z));
        self.line("token inputs:sourceColorSpace = \"sRGB\"");
        self.line(&format!("float2 inputs:st.connect = <{path}/coordinates.outputs:result>"));
        self.line("token inputs:wrapS = \"repeat\"");
        self.line("token inputs:wrapT = \"repeat\"");
        self.line("float3 outputs:rgb");
        self.close();
        self.open("Shader", "coordinates", &[], &[]);
        self.line("uniform token info:id = \"UsdPrimvarReader_float2\"");
        self.line("string inputs:varname = \"st\"");
        self.line("float2 outputs:result");
        self.close();
    }
}

pub(super) fn friction_name(friction: &str) -> String {
    format!("friction_{}", friction.replace(['.', '-'], "_"))
}
