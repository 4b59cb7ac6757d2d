//! Members of an HDF5 group that its reader passes over: links that lead nowhere or into another file, and objects that
//! are neither a group nor a data set.

use std::collections::{BTreeMap, BTreeSet};

use hdf5_reader::btree_v1::collect_btree_v1_leaves_storage;
use hdf5_reader::btree_v2::{BTreeV2Header, BTreeV2Record, collect_btree_v2_records_storage};
use hdf5_reader::error::Result;
use hdf5_reader::fractal_heap::FractalHeap;
use hdf5_reader::group::Group;
use hdf5_reader::io::Cursor;
use hdf5_reader::local_heap::LocalHeap;
use hdf5_reader::messages::HdfMessage;
use hdf5_reader::messages::link::{self, LinkMessage, LinkTarget};
use hdf5_reader::messages::link_info::LinkInfoMessage;
use hdf5_reader::messages::symbol_table_msg::SymbolTableMessage;
use hdf5_reader::object_header::ObjectHeader;
use hdf5_reader::symbol_table::SymbolTableNode;

/// Size of a symbol table node without its entries, bytes, and (`ENTRY`) of an entry without its two offsets.
const NODE: usize = 8;
const ENTRY: usize = 24;
/// Type of a symbol table entry that is a soft link.
const SOFT: u32 = 2;

/// Names of the members that are neither groups nor data sets of this file, each with what it is.
///
/// # Errors
/// If the file is damaged.
pub(super) fn passed_over(group: &Group) -> Result<BTreeMap<String, String>> {
    let (groups, datasets) = group.member_names()?;
    let read: BTreeSet<String> = groups.into_iter().chain(datasets).collect();
    // `member_names` has read the header within its limit of size.
    let (storage, offset, length) = (group.storage(), group.offset_size(), group.length_size());
    let header = ObjectHeader::parse_at_storage(storage, group.address(), offset, length)?;
    let mut all = BTreeMap::new();
    for message in &header.messages {
        match message {
            HdfMessage::Link(found) => all.extend([described(found)]),
            HdfMessage::SymbolTable(table) => all.extend(in_table(group, table)?),
            HdfMessage::LinkInfo(info) if !Cursor::is_undefined_offset(info.fractal_heap_address, offset) => {
                all.extend(in_heap(group, info)?);
            }
            _ => {}
        }
    }
    all.retain(|name, _| !read.contains(name));
    Ok(all)
}

fn described(link: &LinkMessage) -> (String, String) {
    let what = match &link.target {
        LinkTarget::Hard { .. } => other(),
        LinkTarget::Soft { path } => dead(path),
        LinkTarget::External { filename, path } => format!("a link to `{path}` of the file `{filename}`"),
    };
    (link.name.clone(), what)
}

fn dead(path: &str) -> String {
    format!("a link to `{path}`, which does not exist")
}

fn other() -> String {
    "neither a group nor a data set".into()
}

/// Members of a group of the old format, which h5py writes by default.
fn in_table(group: &Group, table: &SymbolTableMessage) -> Result<Vec<(String, String)>> {
    let (storage, offset, length) = (group.storage(), group.offset_size(), group.length_size());
    let heap = LocalHeap::parse_at_storage(storage, table.heap_address, offset, length)?;
    let leaves = collect_btree_v1_leaves_storage(storage, table.btree_address, offset, length, None, &[], None)?;
    let mut found = Vec::new();
    for (_, address) in leaves {
        let head = storage.read_range(address, NODE)?;
        let count = u16::from_le_bytes([head.as_ref()[6], head.as_ref()[7]]);
        let node = storage.read_range(address, NODE + usize::from(count) * (ENTRY + 2 * usize::from(offset)))?;
        for entry in SymbolTableNode::parse(&mut Cursor::new(node.as_ref()), offset, length)?.entries {
            let what = if entry.cache_type == SOFT {
                let [a, b, c, d, ..] = entry.scratch;
                dead(&heap.get_string_storage(u64::from(u32::from_le_bytes([a, b, c, d])), storage)?)
            } else {
                other()
            };
            found.push((heap.get_string_storage(entry.link_name_offset, storage)?, what));
        }
    }
    Ok(found)
}

/// Members of a group of the present format that are too many for its header.
fn in_heap(group: &Group, info: &LinkInfoMessage) -> Result<Vec<(String, String)>> {
    let (storage, offset, length) = (group.storage(), group.offset_size(), group.length_size());
    let heap = FractalHeap::parse_at_storage(storage, info.fractal_heap_address, offset, length)?;
    let tree = BTreeV2Header::parse_at_storage(storage, info.btree_name_index_address, offset, length)?;
    let records = collect_btree_v2_records_storage(storage, &tree, offset, length, None, &[], None)?;
    let mut found = Vec::new();
    for record in records {
        let BTreeV2Record::LinkNameHash { heap_id, .. } = record else { continue };
        let bytes = heap.get_object_storage(&heap_id, storage, offset, length)?;
        found.push(described(&link::parse(&mut Cursor::new(&bytes), offset, length, bytes.len())?));
    }
    Ok(found)
}
