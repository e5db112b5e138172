//! Files for Relume: glTF and OBJ in, EXR and PNG out, light rigs.
