pub mod dense;
pub mod limited;
